"""The Zenoh link. The only module that imports zenoh.

What makes it fast and keeps it alive (measured; see docs/decisions/0004-zenoh-settings.md):

* callbacks run on Zenoh's receive thread (``indirect=False``) and only file bytes;
* ``express=False`` with DROP: nothing is lost through the router, and a put never blocks;
* one runtime thread in everything but a router;
* a star through the router, a 2 s lease.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import os
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

from muro_zenoh.channels import Priority
from muro_zenoh.config import BusSettings
from muro_zenoh.errors import NotConnected, TransportError
from muro_zenoh.transport.link import Closable, FileSample, FileToken, Question, call_on

# Read by Zenoh when it starts its runtime, so it is set before the import. A router must not have it: there it
# would never forward large messages.
_ONE_THREAD = (
    "(app: (worker_threads: 1), rx: (handover: app), tx: (handover: app), acc: (handover: app), net: (handover: app))"
)
if os.environ.get("MURO_ROUTER") != "1":
    os.environ.setdefault("ZENOH_RUNTIME", _ONE_THREAD)
elif os.environ.get("ZENOH_RUNTIME") == _ONE_THREAD:
    del os.environ["ZENOH_RUNTIME"]  # inherited from a process that is no router, not somebody's wish

import zenoh  # noqa: E402 - after its environment
import zenoh.ext  # noqa: E402

log = logging.getLogger(__name__)

R = TypeVar("R")

_PRIORITY = {
    Priority.REAL_TIME: zenoh.Priority.REAL_TIME,
    Priority.HIGH: zenoh.Priority.INTERACTIVE_HIGH,
    Priority.DATA: zenoh.Priority.DATA,
    Priority.BACKGROUND: zenoh.Priority.BACKGROUND,
}

_OPEN_TIMEOUT = 5.0
_FIRST_PAUSE = 0.02
_LONGEST_PAUSE = 0.2
_OWN_TIMEOUT = 0.5
"""Zenoh ends a question at its timeout; should it not, we do this much later [s]."""

_CLOSE_TIMEOUT = 1.0
"""A session that has not closed by then is left to the end of the process, which does not wait for it [s]."""


def zenoh_config(settings: BusSettings) -> zenoh.Config:
    """Zenoh's own configuration for our settings.

    Args:
        settings: a ``config`` file in them comes first; the rest overrides it.

    Raises:
        TransportError: the file or a value is refused by Zenoh.
    """
    try:
        config = zenoh.Config.from_file(settings.config) if settings.config else zenoh.Config()
        for path, value in _settings(settings).items():
            config.insert_json5(path, json.dumps(value))
    except zenoh.ZError as error:
        raise TransportError(f"bus.config {settings.config or '(built in)'}: Zenoh refuses it: {error}") from error
    return config


def _settings(settings: BusSettings) -> dict[str, Any]:
    out: dict[str, Any] = {
        "mode": settings.mode,
        "scouting/multicast/enabled": False,
        # No mesh: the star through the router costs less processor and starts faster.
        "scouting/gossip/enabled": False,
        "scouting/delay": 0,
        "transport/link/tx/lease": int(settings.lease * 1000),
        "transport/link/tx/keep_alive": 4,
        # Frames go through shared memory between processes of one machine, the fleet's table does not: from about 40
        # robots on it is larger than Zenoh's threshold of 3 kB, and each agent would map 40 MB of pools to read it.
        "transport/shared_memory/transport_optimization/message_size_threshold": 65536,
        # A picture is sent in pieces of 64 kB. Zenoh would wait up to 50 ms for room for them when a receiver stalls;
        # sixteen pieces are a raw picture of 720p, so there is room in time, or the picture is dropped.
        "transport/link/tx/queue/size/background": 16,
        "transport/link/tx/queue/congestion_control/drop/max_wait_before_drop_fragments": 1000,  # [us]
        "timestamping/enabled": True,  # the cache behind kept channels wants it
    }
    if settings.connect:
        out["connect/endpoints"] = list(settings.connect)
    if settings.connect or settings.mode != "client":
        # Peers and routers keep trying in the background. A client's open() is one attempt, which we repeat:
        # between two of them it can be cancelled. Once open, it keeps looking for a router that went away, too.
        out["connect/timeout_ms"] = 0 if settings.mode == "client" else -1
        out["connect/exit_on_failure"] = settings.mode == "client"
        out["connect/retry"] = {"period_init_ms": 200, "period_max_ms": 1000, "period_increase_factor": 1.5}
    if settings.listen or settings.mode == "peer":
        out["listen/endpoints"] = list(settings.listen)
    if settings.mode == "router":
        out["adminspace/enabled"] = True
    return out


class _Declared:
    """Something declared on a session. It is undeclared by dropping it, which lets go of the GIL first.

    ``zenoh.ext``'s ``undeclare()`` does not: Zenoh's thread, which hands us a sample, waits for the GIL and holds a
    lock for which ``undeclare()`` waits, for ever (decision 4).
    """

    def __init__(self, declared: Any, held: set[_Declared]) -> None:
        self._declared = declared
        self._held = held
        held.add(self)

    def close(self) -> None:
        self._declared = None
        self._held.discard(self)


class _Publisher(_Declared):
    def put(self, payload: bytes) -> bool:
        if self._declared is None:
            return False
        try:
            self._declared.put(payload)
        except zenoh.ZError:
            return False  # of a session that is closing, or has failed
        return True


class _Query:
    """A question that came over Zenoh."""

    __slots__ = ("_query", "encoding", "payload")

    def __init__(self, query: zenoh.Query) -> None:
        self._query = query
        self.payload = query.payload.to_bytes() if query.payload is not None else b""
        self.encoding: str | None = str(query.encoding) if query.encoding is not None else None

    def reply(self, payload: bytes, encoding: str) -> None:
        with contextlib.suppress(zenoh.ZError), self._query as query:  # the asker may have left
            query.reply(query.key_expr, payload, encoding=encoding)


def _direct(function: Callable[[Any], None]) -> Any:
    """A handler on Zenoh's receive thread: no thread of its own for each subscriber.

    In a pair: given the callback alone, Zenoh keeps what is declared until the session closes, also when it is dropped.
    """
    return zenoh.handlers.Callback(function, indirect=False), None


def _brief(error: Exception) -> str:
    """Zenoh's own words, without the place in its sources."""
    return str(error).splitlines()[0].split(" at /")[0].rstrip(" .!")


async def _open_session(config: zenoh.Config) -> zenoh.Session:
    opening = _in_thread(zenoh.open, config)
    try:
        return await asyncio.shield(opening)
    except asyncio.CancelledError:
        # The thread cannot be stopped; what it opens must not stay open.
        with contextlib.suppress(zenoh.ZError):
            await _in_thread((await opening).close)
        raise


def _in_thread(function: Callable[..., R], *arguments: Any) -> asyncio.Future[R]:
    """Call a function in a thread that ends with it, and that the process's end does not wait for."""
    done, settle = _from_any_thread()

    def work() -> None:
        try:
            result = function(*arguments)
        except BaseException as error:  # raised where it is awaited
            settle(None, error)
        else:
            settle(result)

    threading.Thread(target=work, name="zenoh", daemon=True).start()
    return done


def _from_any_thread() -> tuple[asyncio.Future[Any], Callable[..., None]]:
    """A future of this loop, and what gives it its result, or an error, from any thread; the first one counts."""
    loop = asyncio.get_running_loop()
    future: asyncio.Future[Any] = loop.create_future()

    def settle(result: Any, error: BaseException | None) -> None:
        if future.done():
            return
        if error is None:
            future.set_result(result)
        else:
            future.set_exception(error)

    return future, lambda result, error=None: call_on(loop, settle, result, error)


def _not_open(settings: BusSettings, error: zenoh.ZError) -> TransportError:
    if settings.mode == "client":
        return NotConnected(
            f"no router answered at {', '.join(settings.connect) or 'any endpoint'} within {_OPEN_TIMEOUT:g} s "
            f"({_brief(error)}). Start one with `muro router`, or name another with --connect"
        )
    return TransportError(
        f"could not open a {settings.mode} on {', '.join(settings.listen) or 'no endpoint'}: "
        f"{_brief(error)}. Is the port taken?"
    )


class ZenohLink:
    """A Zenoh session."""

    def __init__(self, session: zenoh.Session, *, client: bool) -> None:
        self._session = session
        self._client = client
        self._held: set[_Declared] = set()
        self._closed = False

    @classmethod
    async def open(cls, settings: BusSettings) -> ZenohLink:
        """Open a session. A client waits for its router, up to a limit.

        Args:
            settings: mode, endpoints and the rest.

        Raises:
            NotConnected: a client found no router.
            TransportError: Zenoh refused the settings, or an endpoint to listen on is taken.
        """
        config = zenoh_config(settings)
        deadline = time.monotonic() + (_OPEN_TIMEOUT if settings.mode == "client" and settings.connect else 0.0)
        pause = _FIRST_PAUSE
        while True:
            try:
                return cls(await _open_session(config), client=settings.mode == "client")
            except zenoh.ZError as error:
                if time.monotonic() + pause > deadline:
                    raise _not_open(settings, error) from error
            await asyncio.sleep(pause)
            pause = min(2.0 * pause, _LONGEST_PAUSE)

    def _hold(self, declared: Any) -> _Declared:
        """It stays declared until it, or this link, is closed, even if the caller drops it."""
        return _Declared(declared, self._held)

    def publisher(self, key: str, *, encoding: str, priority: Priority, keep: bool) -> _Publisher:
        common: dict[str, Any] = {
            "encoding": encoding,
            "priority": _PRIORITY[priority],
            "congestion_control": zenoh.CongestionControl.DROP,
            "express": False,
        }
        if keep:
            declared: Any = zenoh.ext.declare_advanced_publisher(
                self._session, key, cache=zenoh.ext.CacheConfig(max_samples=1), publisher_detection=True, **common
            )
        else:
            declared = self._session.declare_publisher(key, **common)
        return _Publisher(declared, self._held)

    def subscribe(self, key_expr: str, file: FileSample, *, encoding: str, keep: bool) -> Closable:
        put = zenoh.SampleKind.PUT
        usual = zenoh.Encoding(encoding)
        only_key = None if "*" in key_expr or "$" in key_expr else key_expr

        def on_sample(sample: zenoh.Sample) -> None:
            # Text is made only of what is not as usual: this runs for every message, and cold.
            if sample.kind == put:
                sent = sample.encoding
                file(
                    only_key or str(sample.key_expr),
                    sample.payload.to_bytes(),
                    encoding if sent == usual else str(sent),
                )

        handler = _direct(on_sample)
        remote = zenoh.Locality.REMOTE  # what we send ourselves was handed over already
        if keep:
            return self._hold(
                zenoh.ext.declare_advanced_subscriber(
                    self._session,
                    key_expr,
                    handler,
                    allowed_origin=remote,
                    # Each writer keeps one value. A limit here would be one for all the keys of a process together:
                    # of the behaviours of five robots a late joiner would get only the newest.
                    history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
                )
            )
        return self._hold(self._session.declare_subscriber(key_expr, handler, allowed_origin=remote))

    def declare_token(self, key: str) -> Closable:
        return self._hold(self._session.liveliness().declare_token(key))

    def watch_tokens(self, key_expr: str, file: FileToken) -> Closable:
        def on_sample(sample: zenoh.Sample) -> None:
            file(str(sample.key_expr), sample.kind == zenoh.SampleKind.PUT)

        return self._hold(self._session.liveliness().declare_subscriber(key_expr, _direct(on_sample), history=True))

    async def hear_all_tokens(self, key_expr: str, timeout: float) -> bool:
        # The router answers in order: what our subscriber is to be told of comes before the end of this question. Its
        # own answers are not used: Zenoh takes them from what the session knows, at any time. They go into a channel
        # and not to a callback, which would be called with the session locked. An error is a timeout.
        replies = self._session.liveliness().get(key_expr, timeout=timeout)
        answered = _in_thread(lambda: all(reply.ok is not None for reply in replies))
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout + _OWN_TIMEOUT):
                complete = await answered
                # Without its router a client knows of no tokens, and is told at once that these are all.
                return complete and (not self._client or bool(self._session.info.routers_zid()))
        return False

    def answer(self, key: str, file: Callable[[Question], None]) -> Closable:
        return self._hold(self._session.declare_queryable(key, _direct(lambda query: file(_Query(query)))))

    async def ask(self, key: str, payload: bytes, encoding: str, timeout: float) -> bytes | None:
        answer: asyncio.Future[bytes | None]
        answer, post = _from_any_thread()

        def on_reply(reply: zenoh.Reply) -> None:
            if reply.ok is not None:
                post(reply.ok.payload.to_bytes())

        self._session.get(
            key,
            zenoh.handlers.Callback(on_reply, drop=lambda: post(None), indirect=False),
            payload=payload,
            encoding=encoding,
            timeout=timeout,
        )
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(timeout + _OWN_TIMEOUT):
                return await answer
        return None

    async def close(self) -> None:
        """Close the session, in a thread: with a stopped peer it may take its time."""
        if self._closed:
            return
        self._closed = True
        closing = _in_thread(self._close_session)
        try:
            done, _ = await asyncio.wait({closing}, timeout=_CLOSE_TIMEOUT)
        except asyncio.CancelledError:
            # A half-closed session is worse than a late end: the thread cannot be stopped anyway.
            await asyncio.wait({closing}, timeout=_CLOSE_TIMEOUT)
            raise
        if not done:
            log.warning("Zenoh did not close its session within %g s; left to the process's end", _CLOSE_TIMEOUT)

    def _close_session(self) -> None:
        with contextlib.suppress(zenoh.ZError):  # it may have gone already
            self._session.close()
