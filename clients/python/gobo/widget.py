# SPDX-License-Identifier: Apache-2.0
"""The live viewer in a notebook, as a widget of anywidget (`pip install anywidget`; Jupyter, JupyterLab, VS Code, Colab, marimo).

    v = gobo.widget.Viewer("scene.glb", spp=64)
    v                                                     # drag to orbit; controls for every field
    v.edit(lights={"key": {"intensity": 3}})              # from code, a slider's callback for instance

The page's own modules (clients/viewer) steer and make the controls. This module can be imported without anywidget; `Viewer` cannot be made then.
"""
from __future__ import annotations

import json
import os
import re
import threading
import time
from typing import Any, Callable, Dict, List, Mapping, Optional, Tuple, Unpack

from . import camera, errors
from .client import Client, connect
from .fields import Builder, RequestFields
from .result import Result
from .scenes import Scene
from .schema import schema
from .session import Session, _copy, _edited
from .v1 import render_pb2

_FOLDER = os.path.join(os.path.dirname(os.path.abspath(__file__)), "viewer")
#: Fields that the viewer decides itself.
_SKIP = ["scene", "scene_hash", "width", "height", "camera", "encoding", "scheduling", "certificate", "window", "lights", "outputs"]
_PATIENCE = 0.1   # s: a browser that says nothing gets a picture this often


def _text(name: str) -> str:
    try:
        with open(os.path.join(_FOLDER, name), encoding="utf-8") as file:
            return file.read()
    except FileNotFoundError:
        raise ImportError(f"gobo/viewer/{name} is copied by the build: `cmake --build build --target python_client`") from None


def bundle(name: str, constants: Mapping[str, str]) -> str:
    """One module of `name` and the modules beside it that it imports by name; `constants` are texts that they may use."""
    done: List[str] = []
    parts: List[str] = [f"const {key} = {json.dumps(value)};\n" for key, value in constants.items()]

    def add(module: str) -> None:
        if module in done:
            return
        done.append(module)
        exported: List[str] = []

        def take(found: "re.Match[str]") -> str:
            add(found["from"])
            return f"const {{ {found['names'].replace(' as ', ': ')} }} = ${_identifier(found['from'])};"

        def give(found: "re.Match[str]") -> str:
            exported.append(found["name"])
            return found["what"]
        text = re.sub(r"^import \{ (?P<names>[^}]+) \} from '\./(?P<from>[\w.]+)';", take, _text(module), flags=re.MULTILINE)
        text = re.sub(r"^export (?P<what>(?:async )?(?:class|function\*?|const|let) (?P<name>\w+))", give, text, flags=re.MULTILINE)
        if re.search(r"^(?:import|export)\b", text, re.MULTILINE):
            raise ImportError(f"gobo/viewer/{module}: an import or export of another form than this package joins")
        parts.append(f"const ${_identifier(module)} = (() => {{\n{text}\nreturn {{ {', '.join(exported)} }};\n}})();\n")
    add(name)
    return "".join(parts) + f"export default {{ render: ${_identifier(name)}.render }};\n"


def _identifier(module: str) -> str:
    return re.sub(r"\W", "_", module)


class _NoWidget:
    """In the place of anywidget.AnyWidget where there is none."""

    def __init__(self, **_: Any) -> None:
        raise ImportError("gobo.widget.Viewer needs anywidget: pip install anywidget (gobo view SCENE shows the same in a browser)")

    send: Callable[..., None]
    on_msg: Callable[..., None]

    def close(self) -> None:
        pass


try:
    from anywidget import AnyWidget as _Base  # type: ignore[import]
except ImportError:
    _Base = _NoWidget


class Viewer(_Base):  # type: ignore[misc]
    """A picture that one drags, and controls for the fields of its request.

    What the page has changed lies on top of `edit`s from code, those on top of the fields that it was made with.
    """

    _esm = bundle("widget.js", {"CSS": _text("viewer.css").replace(":root", ":host")})

    def __init__(self, scene: "str | os.PathLike[str] | Scene", *, client: Optional[Client] = None,
                 on_picture: Optional[Callable[[Result], Any]] = None, timeout: Optional[float] = None, **fields: "Unpack[RequestFields]") -> None:
        """`client`: None connects to the default server. `on_picture`: called with every picture; their bytes are in `encoded`.
        Other keywords are those of `render`."""
        super().__init__()
        self._own = client is None
        self._gobo: Client = client if client is not None else connect()
        fields.setdefault("format", "jpeg")
        self._hook = on_picture
        self._guard = threading.Lock()
        self._page: Dict[str, Any] = {}
        self._camera: Optional[Dict[str, Any]] = None
        self._held: Optional[Tuple[Dict[str, Any], bytes]] = None
        self._last: Optional[Tuple[Dict[str, Any], bytes]] = None
        self._sent = 0.0
        self._waiting = False
        self._base = self._gobo._request(scene, fields, self._gobo._wire.until(timeout))
        if not self._base.HasField("halt"):
            self._base.halt.spp = 64
        try:
            self._info = self._gobo.scenes.inspect(self._base.scene)
        except errors.NotFound:
            self._info = self._gobo.scenes.open(self._base.scene)
        try:
            self._matrix: Optional[List[float]] = camera.file_matrices(self._gobo, self._base)[0].ravel().tolist()
        except errors.Error:
            self._matrix = None   # the orbit begins at the scene's bounds then
        self._mine = _copy(self._base)
        self.session: Session = self._gobo.session(request=_copy(self._base), timeout=timeout, on_picture=self._picture, on_error=self._error)
        self.on_msg(self._heard)

    @property
    def request(self) -> render_pb2.RenderRequest:
        """A copy of the request that is shown."""
        return self.session.request

    @property
    def result(self) -> Optional[Result]:
        """The newest picture, or None before the first."""
        return self.session.latest

    def edit(self, **fields: "Unpack[RequestFields]") -> int:
        """Changes the request from code, as `Session.edit` does."""
        prepared = self._gobo._environments.put_arrays(fields, None)
        with self._guard:
            self._mine = _edited(self._mine, prepared)
            return self.session.replace(self._joined())

    def reset(self, **fields: "Unpack[RequestFields]") -> int:
        """Forgets the edits from code; those of the page stay."""
        prepared = self._gobo._environments.put_arrays(fields, None)
        with self._guard:
            self._mine = _edited(self._base, prepared)
            return self.session.replace(self._joined())

    def close(self) -> None:
        """Ends the render and the widget, and the connection if the viewer made it."""
        self.session.close()
        if self._own:
            self._gobo.close()
        super().close()

    def _joined(self) -> render_pb2.RenderRequest:
        request = _copy(self._mine)
        builder = Builder(request)
        builder.merge(request, self._page, "")
        if self._camera is not None:
            builder.put("camera", self._camera)
        return request

    def _heard(self, _: Any, content: Any, buffers: Any = None) -> None:
        kind = content.get("type") if isinstance(content, dict) else None
        if kind == "hello":
            low, high = self._info.bounds.tolist()
            self.send({"type": "start", "to": content.get("view"), "schema": schema(), "skip": _SKIP, "lights": list(self._info.lights),
                       "matrix": self._matrix, "bounds": {"min": low, "max": high}, "edits": self._page})
            if self._last is not None:
                self.send({**self._last[0], "to": content.get("view")}, [self._last[1]])
        elif kind == "edit":
            with self._guard:
                before = self._page, self._camera
                try:
                    self._page, self._camera = dict(content.get("edits") or {}), content.get("camera")
                    for name in _SKIP:
                        if name != "lights":
                            self._page.pop(name, None)
                    self.session.replace(self._joined())
                except (TypeError, ValueError, errors.Error) as e:
                    self._page, self._camera = before
                    self.send({"type": "error", "to": content.get("view"), "message": str(e)})
        elif kind == "shown":
            with self._guard:
                self._waiting = False
                held, self._held = self._held, None
            if held is not None:
                self._post(*held)

    def _picture(self, result: Result) -> None:
        image = result.reply.images[0]
        data = next(iter(result.encoded.values()), b"")
        asked = self.session.request   # early pictures are smaller
        width, height = asked.width or 640, asked.height or 480
        parts = [f"{image.width} x {image.height}", f"{result.resolved.halt.spp} samples a pixel", f"{result.total_ms:.0f} ms", f"{result.rays:,} rays"]
        message = {"type": "picture", "edit": result.edit, "final": result.final, "width": width, "height": height,
                   "text": " \u00b7 ".join(parts) + "".join(f" \u2014 {w}" for w in result.warnings)}
        if data:
            self._offer(message, data)
        if self._hook is not None:
            self._hook(result)

    def _offer(self, message: Dict[str, Any], data: bytes) -> None:
        """Sends a picture unless the browser has not shown the one before; the last one of an edit always goes."""
        with self._guard:
            self._last = (message, data)
            if self._waiting and not message["final"] and time.monotonic() - self._sent < _PATIENCE:
                self._held = (message, data)
                return
            self._held = None
        self._post(message, data)

    def _post(self, message: Dict[str, Any], data: bytes) -> None:
        with self._guard:
            self._waiting, self._sent = True, time.monotonic()
        self.send(message, [data])

    def _error(self, error: errors.Error) -> None:
        self.send({"type": "error", "message": error.message})
