"""The table of channels, and the page that is made from it."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from muro_zenoh import channels
from muro_zenoh.channels import CHANNELS, VERBS, alive_in, alive_key, check_name, check_realm, key_of, name_in, verb_key
from muro_zenoh.channels.page import page
from muro_zenoh.errors import ConfigError

PAGE = Path(__file__).parents[2] / "docs" / "channels.md"

names = st.from_regex(r"[a-z][a-z0-9_]{0,31}", fullmatch=True)
realms = st.lists(names, min_size=1, max_size=3).map("/".join)


def test_every_channel_has_a_unique_word() -> None:
    words = [c.word for c in CHANNELS]
    assert len(set(words)) == len(words)
    assert not {"alive", "basestation"} & set(words), "these words are taken by presence and orders"


def test_the_package_has_every_row_of_the_table_and_nothing_that_the_table_only_uses() -> None:
    rows = [row for row in vars(channels).values() if isinstance(row, channels.Channel | channels.Verb)]
    assert rows == [*CHANNELS, *VERBS]
    assert [c.word for c in (channels.CAMERA, channels.FAULTS)] == [CHANNELS[0].word, CHANNELS[-1].word]
    assert [v.word for v in (channels.SET_CIRCLE, channels.GOAL_ORDER)] == [VERBS[0].word, VERBS[-1].word]
    assert not {"Any", "Final", "m", "CONTROL"} & set(vars(channels))


def test_every_verb_has_a_unique_word() -> None:
    words = [v.word for v in VERBS]
    assert len(set(words)) == len(words)


def test_the_table_has_the_rows_of_the_design() -> None:
    rows = {c.word: (c.kind.__name__, c.delivery, c.priority.name) for c in CHANNELS}
    assert rows["pose"] == ("PoseFix", "every", "HIGH")
    assert rows["cmd_vel"] == ("VelocityCommand", "newest", "REAL_TIME")
    assert rows["stop"] == ("StopOrder", "kept", "REAL_TIME")
    assert rows["camera"] == ("Frame", "newest", "BACKGROUND")
    assert rows["circle"] == ("Circle", "kept", "DATA")


def test_the_dead_mans_limit_is_that_of_the_table() -> None:
    assert channels.CMD_VEL.stale_after == 0.3


@given(realm=realms, name=names)
def test_a_name_comes_out_of_the_key_that_it_went_into(realm: str, name: str) -> None:
    for channel in CHANNELS:
        key = key_of(realm, channel, name if channel.named else "")
        assert name_in(realm, channel, key) == (name if channel.named else "")


@given(realm=realms, role=names, name=names)
def test_role_and_name_come_out_of_a_tokens_key(realm: str, role: str, name: str) -> None:
    assert alive_in(realm, alive_key(realm, role, name)) == (role, name)


@given(realm=realms, name=names)
def test_no_two_keys_are_the_same(realm: str, name: str) -> None:
    keys = [key_of(realm, c, name if c.named else "") for c in CHANNELS]
    keys += [verb_key(realm, v, name if v.named else "") for v in VERBS] + [alive_key(realm, "agent", name)]
    assert len(set(keys)) == len(keys)


@pytest.mark.parametrize("name", ["", "R1", "1r", "a b", "a/b", "*", "**", "a$*", "ä", "a" * 33, "r1\n", "-"])
def test_an_invalid_name_is_refused(name: str) -> None:
    with pytest.raises(ConfigError, match="expected lower-case letters"):
        check_name(name)
    if name not in ("", "*"):
        with pytest.raises(ConfigError, match="channel velocity"):
            key_of("muro", channels.VELOCITY, name)


@pytest.mark.parametrize("realm", ["", "/", "muro/", "/muro", "Muro", "a//b", "muro/*", "a b"])
def test_an_invalid_realm_is_refused(realm: str) -> None:
    with pytest.raises(ConfigError, match=r"bus\.realm"):
        check_realm(realm)


def test_a_channel_with_one_key_takes_no_name() -> None:
    with pytest.raises(ConfigError, match="channel circle: got the name 'r1', expected no name"):
        key_of("muro", channels.CIRCLE, "r1")


def test_the_page_matches_the_table() -> None:
    text = PAGE.read_text(encoding="utf-8")
    assert page(text) == text, "docs/channels.md is out of date: run `python -m muro_zenoh.channels docs/channels.md`"


def test_the_page_is_generated_between_its_marks() -> None:
    text = PAGE.read_text(encoding="utf-8")
    stale = text.replace("`muro/circle`", "`muro/ring`")
    assert stale != text
    assert page(stale) == text


def test_a_page_without_marks_is_refused() -> None:
    with pytest.raises(ConfigError, match="generated"):
        page("# Channels\n")
