#!/usr/bin/env python3
# Seeds of the fuzz targets: ours, and from ../shared/data, where it is, small files; glTF with side files that are small has them
# embedded as data URIs. usage: fuzz/make_seeds.py OUT [DATA]
import base64, json, pathlib, random, struct, sys, zlib

out = pathlib.Path(sys.argv[1])
data = pathlib.Path(sys.argv[2] if len(sys.argv) > 2 else "../shared/data")
GLTF, PICTURE = 24 << 10, 8 << 10
counts = {}


def put(target, name, content):
    folder = out / target
    folder.mkdir(parents=True, exist_ok=True)
    (folder / name.replace("/", "_").replace(" ", "_")[-120:]).write_bytes(content)
    counts[target] = counts.get(target, 0) + 1


def embedded(path):
    try:
        document = json.loads(path.read_bytes())
    except (ValueError, UnicodeDecodeError, RecursionError):
        return None
    if not isinstance(document, dict):
        return None
    for kind in ("buffers", "images"):
        items = document.get(kind)
        for item in items if isinstance(items, list) else []:
            uri = item.get("uri") if isinstance(item, dict) else None
            if not isinstance(uri, str) or uri.startswith("data:"):
                continue
            try:
                side = (path.parent / uri).resolve()
                if side.is_file() and side.stat().st_size <= GLTF and data.resolve() in side.parents:
                    mime = "image/png" if uri.endswith("png") else "application/octet-stream"
                    item["uri"] = f"data:{mime};base64," + base64.b64encode(side.read_bytes()).decode()
            except (OSError, ValueError):
                pass
    return json.dumps(document, separators=(",", ":")).encode()


for path in sorted(data.rglob("*")):
    if not path.is_file() or path.suffix in (".md", ".tsv", ".rst"):
        continue
    name, size = str(path.relative_to(data)), path.stat().st_size
    if path.suffix in (".gltf", ".glb") and size <= 2 * GLTF:
        raw = path.read_bytes()
        if len(raw) <= GLTF:
            put("gltf", name, raw)
        more = embedded(path) if path.suffix == ".gltf" else None
        if more and more != raw and len(more) <= GLTF:
            put("gltf", "embedded_" + name, more)
    elif name.split("/")[0] in ("exr", "hdr", "images") and size <= PICTURE:
        put("image", name, path.read_bytes())

request = {"scene": "rich", "width": 64, "height": 48, "outputs": ["beauty", "depth"], "seed": 7, "viewSamples": 4, "halt": {"spp": 16, "error": 0.1},
           "camera": {"position": {"x": 1, "y": 2, "z": 3}, "lookAt": {"y": 1}, "up": {"y": 1}, "yfovDeg": 40},
           "lights": {"lamp": {"color": {"x": 1, "y": 0.5}, "intensity": 20, "gain": {"x": 2, "y": 2, "z": 2}},
                      "new": {"kind": "RECT", "position": {"z": 3}, "direction": {"z": -1}, "width": 1, "height": 2},
                      "sun": {"direction": {"y": -1}, "enabled": False}},
           "environment": {"constant": {"x": 0.5}, "rotationDeg": 30, "gain": {"x": 2}}, "integrator": {"maxBounces": 4, "lightSelection": "POWER"},
           "toneMap": {"exposure": 1, "curve": "LINEAR"}, "encoding": {"format": "PNG"}, "certificate": {"spp": 16}}
put("request_json", "all.json", json.dumps(request).encode())
for key, value in request.items():
    put("request_json", key + ".json", json.dumps({key: value}).encode())
put("request_json", "sets", b"halt.spp=128\nlights.lamp.color=1,0.9,0.8\nlights.a.b.intensity=2\noutputs=beauty,depth\nenvironment.sky=\nshadows.path_traced=\ncamera.position=1,2,3\n")
# Wire bytes by hand: seeds should not need a protobuf package.
varint = lambda v: bytes([v]) if v < 128 else bytes([v & 127 | 128]) + varint(v >> 7)
text = lambda field, v: varint(field << 3 | 2) + varint(len(v)) + v
vector = b"\x0d" + struct.pack("<f", 1) + b"\x15" + struct.pack("<f", 0.5)
lamp = text(1, b"lamp") + text(2, text(2, vector) + b"\x19" + struct.pack("<d", 5))
put("request_proto", "render", b"\0" + text(1, b"rich") + b"\x18\x40\x20\x30" + text(5, b"beauty") + text(10, lamp) + text(2, text(2, vector)))
put("request_proto", "relight", b"\1" + text(1, b"r1") + text(2, text(10, lamp)) + text(3, b"lights.lamp.color"))
put("request_proto", "patch", b"\2" + text(1, b"rich") + text(2, text(1, b"plain") + text(2, text(1, vector))) + text(4, lamp))
put("request_proto", "job", b"\3" + text(1, b"name") + text(2, text(1, b"rich")) + text(3, b"\x08\x01\x10\x05"))
put("blob", "raw", b"\0GOBOBLOB")
put("blob", "bytes", b"\1\x90\x00\x05\x20\x03\xff")
for field in range(0, 400, 7):
    put("blob", f"field{field}", b"\2" + struct.pack("<HBI", field, field % 5, field * 2654435761 % (1 << 32)))
# The smallest pictures of three formats, 4 by 2.
chunk = lambda kind, body: struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))
rows = b"".join(b"\0" + bytes(range(12 * y, 12 * y + 12)) for y in range(2))
put("image", "png", b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", 4, 2, 8, 2, 0, 0, 0)) + chunk(b"IDAT", zlib.compress(rows)) + chunk(b"IEND", b""))
put("image", "hdr", b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 2 +X 4\n" + bytes(v for i in range(8) for v in (40 * (i % 4), 128, 30 * i, 129)))
attribute = lambda name, kind, body: name + b"\0" + kind + b"\0" + struct.pack("<I", len(body)) + body
window = struct.pack("<4i", 0, 0, 3, 1)
head = struct.pack("<II", 20000630, 2) + attribute(b"channels", b"chlist", b"Y\0" + struct.pack("<iIii", 2, 0, 1, 1) + b"\0") + attribute(b"compression", b"compression", b"\0")
head += attribute(b"dataWindow", b"box2i", window) + attribute(b"displayWindow", b"box2i", window) + attribute(b"lineOrder", b"lineOrder", b"\0")
head += attribute(b"pixelAspectRatio", b"float", struct.pack("<f", 1)) + attribute(b"screenWindowCenter", b"v2f", struct.pack("<ff", 0, 0)) + attribute(b"screenWindowWidth", b"float", struct.pack("<f", 1)) + b"\0"
lines = [struct.pack("<iI4f", y, 16, y, 0.5, 2, 4) for y in range(2)]
put("image", "exr", head + struct.pack("<QQ", len(head) + 16, len(head) + 16 + len(lines[0])) + b"".join(lines))
# Any bytes are a request and calls (fuzz/served): a fixed stream of them.
stream = random.Random(1)
for k in range(24):
    put("rendered_request", f"bytes{k}", bytes([stream.randrange(256), k % 12]) + stream.randbytes(10 * (k % 12)))
    put("sequence", f"bytes{k}", stream.randbytes(40 + 20 * (k % 12)))
for target in sorted(counts):
    print(f"{target}: {counts[target]} seeds")
