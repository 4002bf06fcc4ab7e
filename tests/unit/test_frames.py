import contextlib

import cv2
import numpy as np
import pytest

from basestation.localization.frames import decode_frame, jpeg_size
from muro_zenoh.errors import MessageError
from muro_zenoh.optics.jpeg import encode_jpeg

PICTURE = np.arange(48 * 64, dtype=np.uint32).reshape(48, 64).__mod__(251).astype(np.uint8)
JPEG = encode_jpeg(PICTURE, 95)


def test_grey_bytes_are_the_picture() -> None:
    assert (decode_frame("grey", 64, 48, PICTURE.tobytes()) == PICTURE).all()


def test_a_jpeg_is_the_picture_but_for_its_losses() -> None:
    picture = decode_frame("jpeg", 64, 48, JPEG)
    assert picture.shape == (48, 64)
    assert picture.dtype == np.uint8
    assert np.abs(picture.astype(int) - PICTURE).mean() < 4.0


def test_a_colour_jpeg_becomes_grey() -> None:
    colour = np.zeros((48, 64, 3), np.uint8)
    colour[..., 1] = 200  # green weighs 0.587
    data = cv2.imencode(".jpg", colour)[1].tobytes()
    assert decode_frame("jpeg", 64, 48, data).mean() == pytest.approx(117.0, abs=2.0)


def test_a_progressive_jpeg_states_its_size_too() -> None:
    data = cv2.imencode(".jpg", PICTURE, (cv2.IMWRITE_JPEG_PROGRESSIVE, 1))[1].tobytes()
    assert jpeg_size(data) == (64, 48)


@pytest.mark.parametrize(
    ("encoding", "data", "problem"),
    [
        ("grey", PICTURE.tobytes()[:-1], r"3071 bytes, expected 64 x 48 = 3072"),
        ("grey", b"", "0 bytes"),
        ("h264", JPEG, "'h264', expected 'jpeg' or 'grey'"),
        ("jpeg", b"", "nothing"),
        ("jpeg", PICTURE.tobytes(), "expected ffd8"),
        ("jpeg", JPEG[:400], "truncated"),
        ("jpeg", JPEG[:20], "without a frame header"),
        ("jpeg", b"\xff\xd8" + b"\xff" * 5000, "without a frame header"),
        ("jpeg", b"\xff\xd8\xff\xe0\x00\x00" * 50, "without a frame header"),
        ("jpeg", encode_jpeg(PICTURE[:40]), "64 x 40 pixels, expected 64 x 48"),
    ],
)
def test_anything_else_is_refused(encoding: str, data: bytes, problem: str) -> None:
    with pytest.raises(MessageError, match=problem):
        decode_frame(encoding, 64, 48, data)


def test_random_damage_gives_a_picture_or_a_refusal() -> None:
    rng = np.random.default_rng(0)
    for _ in range(300):
        damaged = bytearray(JPEG)
        for place in rng.integers(2, len(JPEG) - 2, size=6):
            damaged[place] = int(rng.integers(0, 256))
        with contextlib.suppress(MessageError):
            assert decode_frame("jpeg", 64, 48, bytes(damaged)).shape == (48, 64)
