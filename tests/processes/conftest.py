"""Checks that no test of a process leaves tasks, threads or processes behind."""

from __future__ import annotations

from tests.support.leaks import no_task_left, no_thread_or_process_left

__all__ = ["no_task_left", "no_thread_or_process_left"]
