"""The loop in virtual time: its processes, the order between them, and what it refuses."""

from __future__ import annotations

import asyncio

import pytest

from muro_zenoh.runtime.virtual_time import VirtualClock, VirtualLoop, VirtualProcess, run_virtually


def process(name: str) -> VirtualProcess:
    loop = asyncio.get_running_loop()
    assert isinstance(loop, VirtualLoop)
    return VirtualProcess(loop, name)


def orders(seed: int) -> list[str]:
    """The order in which three processes do two steps each at one instant."""
    done: list[str] = []

    async def steps(name: str) -> None:
        await asyncio.sleep(1.0)
        done.append(f"{name}1")
        await asyncio.sleep(0)
        done.append(f"{name}2")

    async def main() -> None:
        await asyncio.wait({process(name).create_task(steps(name)) for name in "abc"})

    run_virtually(main(), seed)
    return done


def test_the_order_between_processes_is_drawn_from_the_seed() -> None:
    seen = {tuple(orders(seed)) for seed in range(40)}
    assert len(seen) > 10
    assert orders(7) == orders(7)
    for order in seen:  # within a process it is asyncio's
        assert all(order.index(f"{name}1") < order.index(f"{name}2") for name in "abc")


def test_within_a_process_callbacks_keep_their_order() -> None:
    done: list[int] = []

    async def main() -> None:
        for number in range(50):
            asyncio.get_running_loop().call_later(0.5, done.append, number)
        await asyncio.sleep(1.0)

    run_virtually(main(), seed=3)
    assert done == list(range(50))


def test_a_frozen_process_does_nothing_and_makes_up_for_it_when_it_wakes() -> None:
    ticks: list[tuple[int, float]] = []

    async def tick() -> None:
        loop = asyncio.get_running_loop()
        for number in range(5):
            loop.call_at(number + 1.0, lambda number=number: ticks.append((number, loop.time())))
        await asyncio.sleep(10.0)

    async def main() -> None:
        frozen = process("frozen")
        frozen.create_task(tick())
        await asyncio.sleep(1.5)
        frozen.freeze()
        await asyncio.sleep(3.0)
        assert [number for number, _ in ticks] == [0]
        frozen.thaw()
        await asyncio.sleep(1.0)

    run_virtually(main())
    assert ticks == [(0, 1.0), (1, 4.5), (2, 4.5), (3, 4.5), (4, 5.0)]


def test_a_process_can_be_frozen_by_what_it_does_itself() -> None:
    done: list[str] = []

    async def main() -> None:
        frozen = process("frozen")

        async def freeze() -> None:
            frozen.freeze()

        async def later() -> None:
            done.append("ran")

        frozen.create_task(freeze())
        frozen.create_task(later())
        await asyncio.sleep(1.0)
        assert done == []
        frozen.thaw()
        await asyncio.sleep(0.1)

    run_virtually(main())
    assert done == ["ran"]


def test_what_a_task_starts_belongs_to_its_process() -> None:
    done: list[str] = []

    async def child() -> None:
        await asyncio.sleep(1.0)
        done.append("child")

    async def parent() -> None:
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(child())

    async def main() -> None:
        frozen = process("frozen")
        frozen.create_task(parent())
        await asyncio.sleep(0.5)
        frozen.freeze()
        await asyncio.sleep(5.0)

    run_virtually(main())
    assert done == []


def test_tasks_of_a_group_are_cancelled_in_the_order_of_their_start() -> None:
    """A TaskGroup keeps them in a set, whose order is by address for other tasks."""
    ended: list[int] = []

    async def wait(number: int) -> None:
        try:
            await asyncio.sleep(10.0)
        finally:
            ended.append(number)

    async def main() -> None:
        async with asyncio.TaskGroup() as tasks:
            children = [tasks.create_task(wait(number)) for number in range(50)]
            assert list({hash(child) for child in children}) == [hash(child) for child in children]
            await asyncio.sleep(1.0)
            for child in tasks._tasks:
                child.cancel()

    run_virtually(main())
    assert ended == list(range(50))


def test_a_deadlock_is_an_error() -> None:
    async def main() -> None:
        await asyncio.Event().wait()

    with pytest.raises(RuntimeError, match="deadlock in virtual time"):
        run_virtually(main())


def test_a_cancelled_timer_does_not_hide_a_deadlock() -> None:
    async def main() -> None:
        asyncio.get_running_loop().call_later(5.0, print).cancel()
        await asyncio.Event().wait()

    with pytest.raises(RuntimeError, match="deadlock in virtual time"):
        run_virtually(main())


def test_tasks_that_let_no_time_pass_are_an_error() -> None:
    async def main() -> None:
        while True:  # noqa: ASYNC110 - this is the mistake
            await asyncio.sleep(0)

    with pytest.raises(RuntimeError, match=r"stuck in virtual time: got more than \d+ callbacks at 0\.0+ s"):
        run_virtually(main())


def test_a_clock_of_its_own_may_be_wrong() -> None:
    async def main() -> tuple[float, float]:
        right, wrong = VirtualClock(), VirtualClock(offset=3.0)
        wrong.drift = 0.01
        await asyncio.sleep(100.0)
        return right.now(), wrong.now()

    right, wrong = run_virtually(main())
    assert right == 1.7e9 + 100.0
    assert wrong - right == pytest.approx(4.0, abs=1e-6)
