# SPDX-License-Identifier: Apache-2.0
"""gobo.aio: the same answers as the plain client, side by side in one loop, and what a cancelled task ends on the server."""
import asyncio
import inspect
import threading
import time
import unittest

import numpy as np

import gobo
from support import SMALL, JobsTest, Liar, events

FOREVER = dict(width=320, height=240, spp=1 << 20)


class Server(JobsTest):
    def run_(self, work):
        async def main():
            async with gobo.aio.connect(self.client.address, timeout=120) as client:
                return await asyncio.wait_for(work(client), 90)
        return asyncio.run(main())

    async def until(self, client, what):
        while not what(await client.status()):
            await asyncio.sleep(0.005)

    def test_the_same_pictures(self):
        async def work(c):
            news = []
            r = await c.render("cornell", **SMALL)
            warm = await c.relight(r, lights={"light": {"gain": 2}})
            again = await gobo.aio.relight(warm, lights={"light": None})
            long = await c.render("cornell", width=128, height=96, spp=256, seed=9, on_progress=lambda p: news.append(threading.current_thread()))
            plan = await c.plan("cornell", **SMALL)
            return r, warm, again, news, long, plan
        r, warm, again, news, long, plan = self.run_(work)
        plain = self.client.render("cornell", **SMALL)
        np.testing.assert_array_equal(r.image, plain.image)
        np.testing.assert_array_equal(again.image, plain.image)
        np.testing.assert_array_equal(warm.image, plain.relight(lights={"light": {"gain": 2}}).image)
        self.assertEqual((set(news), long.final, plan.rays), ({threading.main_thread()}, True, 0))

    def test_calls_run_side_by_side(self):
        async def work(c):
            return await asyncio.gather(*(c.render("cornell", **SMALL, seed=seed) for seed in range(12)))
        for seed, r in enumerate(self.run_(work)):
            np.testing.assert_array_equal(r.image, self.client.render("cornell", **SMALL, seed=seed).image)

    def test_snapshots(self):
        async def work(c):
            seen = [s async for s in c.render_progressive("cornell", width=64, height=48, spp=64, seed=3)]
            lit = [s async for s in c.relight_progressive(seen[-1], lights={"light": 2}, seed=4)]
            return seen, lit
        for seen in self.run_(work):
            self.assertEqual([s.final for s in seen], [False] * (len(seen) - 1) + [True])

    def test_a_cancelled_task_ends_its_render(self):
        async def next_of(stream):
            async for _ in stream:
                pass

        async def work(c):
            small = await c.render("cornell", width=16, height=12, spp=16)
            for make in (lambda: c.render("cornell", **FOREVER, seed=1), lambda: c.relight(small, **FOREVER, seed=2),
                         lambda: next_of(c.render_progressive("cornell", **FOREVER, seed=3)), lambda: next_of(c.relight_progressive(small, **FOREVER, seed=4))):
                task = asyncio.ensure_future(make())
                await self.until(c, lambda status: status.running == 1)
                task.cancel()
                with self.assertRaises(asyncio.CancelledError):
                    await task
                await self.until(c, lambda status: status.running == 0)
            with self.assertRaises(asyncio.TimeoutError):
                await asyncio.wait_for(c.render("cornell", **FOREVER, seed=5), 0.2)
            await self.until(c, lambda status: status.running == 0)
        self.run_(work)

    def test_ends_of_a_stream(self):
        async def work(c):
            async with c.render_progressive("cornell", **FOREVER, seed=6) as stream:
                async for snapshot in stream:
                    self.assertFalse(snapshot.final)
                    break
            await self.until(c, lambda status: status.running == 0)
            self.assertEqual([s async for s in stream], [])
            stream = c.render_progressive("cornell", **FOREVER, seed=7)
            asyncio.get_running_loop().call_later(0.3, stream.cancel)
            with self.assertRaises(gobo.Cancelled):
                async for _ in stream:
                    pass
            stream = c.render_progressive("cornell", **FOREVER, seed=8)
            asyncio.get_running_loop().call_later(0.3, stream.close)
            async for _ in stream:
                pass
            await self.until(c, lambda status: status.running == 0)
        self.run_(work)

    def test_session(self):
        async def work(c):
            async with await c.session("cornell", **SMALL) as s:
                s.edit(lights={"light": 3})
                async for picture in s.pictures(60):
                    if picture.edit == 1:
                        break
                last = await s.wait(60)
                waiting = asyncio.ensure_future(s.pictures().__anext__())
                await asyncio.sleep(0)
                s.edit(lights={"light": 2})
                await waiting
                # A task that waits for news that do not come leaves no thread behind.
                await s.wait(60)
                more = s.pictures()
                await more.__anext__()
                waiting = asyncio.ensure_future(more.__anext__())
                await asyncio.sleep(0.05)
                waiting.cancel()
                with self.assertRaises(asyncio.CancelledError):
                    await waiting
                while any(t.name == "gobo-aio" for t in threading.enumerate()):
                    await asyncio.sleep(0.005)
                return last
        np.testing.assert_array_equal(self.run_(work).image, self.client.render("cornell", **SMALL, lights={"light": 3}).image)

    def test_scenes_and_jobs(self):
        async def work(c):
            self.assertIn("cornell", await c.scenes.builtin())
            scene = await c.scenes.open("cornell", name="mine")
            self.assertEqual((await c.scenes.inspect(scene)).id, "mine")
            self.assertIn("mine", [s.id for s in await c.scenes.list()])
            await c.scenes.patch(scene, lights={"light": {"gain": 2}})
            await c.scenes.unload(scene)
            id = await c.jobs.submit("cornell", frames=(0, 1), **SMALL)
            states = [s async for s in c.jobs.watch(id)]
            self.assertEqual((states[-1].state, (await c.jobs.wait(id)).state, (await c.jobs.get(id)).state), ("done",) * 3)
            self.assertEqual(sorted(await c.jobs.images(id)), [0, 1])
            self.assertEqual(len(await c.jobs.fetch(id, self.folder)), 2)
            self.assertIn(id, [j.id for j in await c.jobs.list(states=["done"])])
            await c.jobs.delete(id)
            long = await c.jobs.submit("cornell", **FOREVER)
            task = asyncio.ensure_future(c.jobs.wait(long))
            await asyncio.sleep(0.1)
            task.cancel()
            with self.assertRaises(asyncio.CancelledError):
                await task
            self.assertFalse((await c.jobs.get(long)).ended)
            await c.jobs.pause(long)
            await c.jobs.resume(long)
            self.assertEqual((await c.jobs.cancel(long)).state, "cancelled")
            self.assertIn((await c.jobs.retry(long)).state, ("queued", "running"))
            self.assertEqual((await c.jobs.prioritize(long, "low")).message.spec.priority, 1)
            await c.jobs.cancel(long)
            waiting = await c.jobs.submit("cornell", **SMALL, after=[long])
            self.assertEqual((await c.jobs.get(waiting)).waits_for, [long])
            self.assertEqual((await c.jobs.depend(waiting, ())).waits_for, [])
            self.assertEqual((await c.jobs.log(waiting, most=1000))[0].kind, "submitted")
            await c.drop_caches()
        self.run_(work)


class Small(unittest.TestCase):
    def test_errors_are_the_same(self):
        async def work():
            with self.assertRaises(gobo.Unavailable):
                async with gobo.aio.connect("unix:/nonesuch", timeout=5):
                    pass
            client = gobo.aio.connect("unix:/nonesuch", timeout=5)
            await client.close()
            with self.assertRaises(gobo.Cancelled):
                await client.status()
        asyncio.run(work())

    def test_a_loop_that_is_gone_is_no_fault(self):
        stop = threading.Event()

        def slow(request, context):
            stop.wait(30)
            yield from events()
        with Liar(Render=slow) as liar:
            client = gobo.connect(liar.address)

            async def work():
                task = asyncio.ensure_future(gobo.aio.AsyncClient(client).render("x"))
                await asyncio.sleep(0.1)
                task.cancel()
            asyncio.run(work())
            stop.set()
            self.assertEqual(client.render("x").image.shape, (1, 2, 3), "the client goes on")
            client.close()

    def test_every_call_of_the_client_is_there(self):
        for plain, awaited in ((gobo.Client, gobo.aio.AsyncClient), (gobo.Scenes, gobo.aio.AsyncScenes), (gobo.Jobs, gobo.aio.AsyncJobs)):
            for name, call in inspect.getmembers(plain, inspect.isfunction):
                if name.startswith("_") or name == "resolve":
                    continue
                mine = getattr(awaited, name)
                want = [p for p in inspect.signature(call).parameters if p not in ("cancel", "on_picture", "on_error")]
                have = list(inspect.signature(mine).parameters)
                if name in ("render_progressive", "relight_progressive"):
                    want.remove("on_progress")
                self.assertEqual(have, want, f"{plain.__name__}.{name}")


if __name__ == "__main__":
    unittest.main()
