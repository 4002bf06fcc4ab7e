"""The pictures of a trial: what is on the floor is in them."""

from __future__ import annotations

import dataclasses
import re

import msgspec
import pytest

from muro_zenoh.checking.animation import animation
from muro_zenoh.checking.judgement import Breach
from muro_zenoh.checking.picture import draw_floor
from muro_zenoh.checking.record import Record
from muro_zenoh.config.wall import WallRow
from tests.support.records import driving, still


def walled() -> Record:
    record = driving(still(2), 0, 0.0, 2.0)
    wall = WallRow(start=(0.0, -1.5), end=(0.0, -0.4))
    return dataclasses.replace(record, scenario=msgspec.structs.replace(record.scenario, wall=(wall,)))


def test_the_animation_shows_the_walls_in_the_place_in_which_it_shows_robots() -> None:
    record = walled()
    record.pose[:, 1, :2] = 0.0, -0.4  # the second robot stands at the end of the wall
    shown = animation(record, (Breach("inside", 1.0, ("r2",), "r2 touches it"),))
    [(x, _, x_end, y_end)] = re.findall(r'<line x1="([\d.]+)" y1="([\d.]+)" x2="([\d.]+)" y2="([\d.]+)"', shown)
    [(ring_x, ring_y)] = re.findall(r'<circle cx="([\d.]+)" cy="([\d.]+)"', shown)
    assert x == x_end == ring_x
    assert y_end == ring_y
    assert re.search(rf'values="{x_end},{y_end};', shown), "its body"


def test_the_picture_of_a_breach_shows_the_walls() -> None:
    pyplot = pytest.importorskip("matplotlib.pyplot")
    figure, axes = pyplot.subplots()
    draw_floor(axes, walled(), Breach("inside", 1.0, ("r1",), "r1 touches it"))
    lines = [line.get_xydata().tolist() for line in axes.lines]
    assert [[0.0, -1.5], [0.0, -0.4]] in lines
    pyplot.close(figure)
