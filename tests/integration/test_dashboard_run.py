"""The page of a real run: served by a child of the base station, which may die, and break what is simulated."""

from __future__ import annotations

import asyncio
import re
import signal
import tomllib
import urllib.request
from pathlib import Path

import psutil
import pytest
from websockets.asyncio.client import connect
from websockets.exceptions import ConnectionClosed, InvalidMessage

from basestation.dashboard.access import Address, address_of, tokens_in
from tests.support.page import PageClient
from tests.support.process import Process
from tests.support.waiting import seconds

LAB = 'robots = 2\nduration = 90\n[camera.north]\n[behaviour]\nname = "hold"\n'


class Page:
    """The page of a run, as its operator finds it."""

    def __init__(self, run: Process) -> None:
        found = re.search(r"page: http://(\S+)/#token=(\S+)", run.line("page: ", 30.0))
        assert found
        self.address: Address = address_of(found[1])
        self.token = found[2]

    def process(self, run: Process) -> psutil.Process:
        """The page's process: the only child of the base station."""
        for child in psutil.Process(run.pid).children():
            if "basestation" in child.cmdline():
                (page,) = child.children()
                return page
        raise AssertionError("no base station")

    async def open(self) -> tuple[PageClient, asyncio.Task[None]]:
        """Connect, as soon as it is served."""
        async with asyncio.timeout(seconds(20.0)):
            while True:
                try:
                    socket = await connect(
                        f"ws://{self.address.text}/ws",
                        subprotocols=["muro", f"token.{self.token}"],  # type: ignore[list-item]
                        max_size=None,
                    )
                    break
                except (OSError, InvalidMessage, ConnectionClosed):
                    await asyncio.sleep(0.1)
        client = PageClient(socket)
        return client, asyncio.create_task(client.read())


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("lab.toml").write_text(LAB)


def kept(name: str) -> Path:
    """A file in the folder of the run."""
    (file,) = Path("runs").glob(f"*/{name}")
    return file


def run(*options: str) -> Process:
    return Process(["-m", "muro_zenoh", "run", "lab.toml", "--headless", "--web", "127.0.0.1:0", *options], name="run")


def blocks_on_signal() -> str:
    """A folder for PYTHONPATH with which a process that gets SIGUSR1 stands still, and keeps the GIL."""
    code = "import ctypes, signal\nsignal.signal(signal.SIGUSR1, lambda *_: ctypes.PyDLL(None).sleep(3600))\n"
    Path("sitecustomize.py").write_text(code)
    return str(Path.cwd())


async def test_a_run_serves_a_page_that_comes_back_with_its_base_station() -> None:
    with run() as process:
        page = Page(process)
        assert "127.0.0.1" in process.line("      to look and to stop only: http://127.0.0.1:")
        client, reading = await page.open()
        assert client.socket.subprotocol == "muro"
        await client.until(lambda: client.state.get("robots", {}).keys() == {"r1", "r2"}, 3.0, "every robot")
        await client.until(lambda: client.details("r2").get("reason") == "the behaviour is hold", 15.0, "the reason")
        await client.until(lambda: client.state["processes"].get("r1", {}).get("memory"), 10.0, "memory of a process")
        index = await asyncio.to_thread(lambda: urllib.request.urlopen(f"http://{page.address.text}/").read())
        assert b"<title>" in index

        of_page = page.process(process)
        of_page.parent().kill()  # type: ignore[union-attr]
        await client.until(lambda: client.closed, 10.0, "disconnected")
        await asyncio.to_thread(psutil.wait_procs, [of_page], seconds(5.0))
        assert not of_page.is_running()
        await reading
        client, reading = await page.open()  # with the token and at the address of before
        await client.until(lambda: client.details("r1").get("reason") == "the behaviour is hold", 20.0, "it is back")
        assert client.hello["may_steer"]

        page.process(process).kill()  # the page alone: the base station starts it anew and goes on
        await client.until(lambda: client.closed, 10.0, "disconnected")
        client, reading = await page.open()
        await client.until(lambda: client.states > 5, 10.0, "it is back again")
        reading.cancel()
        await client.socket.close()
        of_page = page.process(process)
    assert not of_page.is_running()
    assert page.token not in kept("muro.log").read_text(), "the log may be read by others"
    assert kept("page-tokens.json").stat().st_mode & 0o077 == 0
    assert tokens_in(kept("page-tokens.json")).operator == page.token


async def test_a_page_that_stands_still_is_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody could stop the fleet with it."""
    monkeypatch.setenv("PYTHONPATH", blocks_on_signal())
    with run() as process:
        page = Page(process)
        client, reading = await page.open()
        blocked = page.process(process)
        blocked.send_signal(signal.SIGUSR1)
        await client.until(lambda: client.closed, 15.0, "disconnected")  # its watchdog waits for 10 s
        await reading
        client, reading = await page.open()
        await client.until(lambda: client.states > 5, 10.0, "another page")
        assert page.process(process).pid != blocked.pid
        reading.cancel()
        await client.socket.close()


async def test_what_an_operator_breaks_happens_and_is_kept() -> None:
    with run() as process:
        page = Page(process)
        client, reading = await page.open()
        await client.until(lambda: client.hello.get("simulated"), 10.0, "a simulated fleet")
        assert client.hello["faults"]["carry"]["targets"] == ["r1", "r2"]
        await client.until(lambda: client.details("r2").get("state") == "holding", 15.0, "r2 is seen")
        x = client.state["robots"]["r2"][0]
        away = {"x": 0.4 if x < 0.0 else -0.4}
        reply = await client.order("break", kind="carry", target="r2", duration=0.5, numbers=away)
        assert reply["outcome"] == "taken", reply
        await client.until(lambda: abs(client.state["robots"]["r2"][0] - x) > 0.3, 10.0, "r2 was carried off")
        reply = await client.order("break", kind="crash", target="r1/agent", duration=1.0)
        assert reply["outcome"] == "taken", reply
        await client.until(lambda: client.details("r1").get("state") == "absent", 10.0, "r1 has no agent")
        await client.until(lambda: client.details("r1").get("state") == "holding", 20.0, "it has one again")
        reply = await client.order("break", kind="camera_dropout", target="camera", duration=seconds(30.0))
        assert reply["outcome"] == "taken", reply
        await client.until(lambda: client.details("r2").get("state") == "lost", 15.0, "no camera sees r2")
        reply = await client.order("break", kind="delay", target="r2/agent", numbers={"delay": 0.4})
        assert (reply["outcome"], reply["reason"]) == ("taken", "r2 was started anew, to put a relay into its link")
        refusals = {
            "lie": ({"target": "r1"}, "it can only be simulated"),
            "freeze": ({"target": "r1"}, "expected one of 'r1/agent'"),
            "carry": ({"target": "r1"}, "how long it is carried"),
            "delay": ({"target": "router", "numbers": {"delay": 0.1}}, "without a relay"),
            "jitter": ({"target": "r1/agent", "numbers": {"jitter": 99.0}}, "at most 10"),
        }
        for kind, (values, reason) in refusals.items():
            reply = await client.order("break", kind=kind, **values)
            assert reply["outcome"] == "refused"
            assert reason in reply["reason"], reply
        await client.until(lambda: "delay" in client.state["faults"]["rows"], 5.0, "rows")
        rows = tomllib.loads(client.state["faults"]["rows"])["fault"]
        assert [row["kind"] for row in rows] == ["carry", "crash", "camera_dropout", "delay"]
        assert all(row["at"] > 0.0 for row in rows)
        assert tomllib.loads(kept("faults.toml").read_text())["fault"] == rows
        assert "camera_dropout camera" in client.state["faults"]["lasting"]
        reading.cancel()
        await client.socket.close()


def test_a_run_without_a_page(tmp_path: Path) -> None:
    (tmp_path / "lab.toml").write_text(LAB.replace("90", "0.5"))
    with Process(["-m", "muro_zenoh", "run", "lab.toml", "--headless", "--no-web"], name="run") as process:
        process.line("all processes ready", 30.0)
        assert "page:" not in process.last_lines()
