"""Decodes a camera's frames."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from muro_zenoh.errors import MessageError

Picture = NDArray[np.uint8]


def decode_frame(encoding: str, width: int, height: int, data: bytes) -> Picture:
    """The picture in a frame's payload.

    Args:
        encoding: ``jpeg``, or ``grey`` for ``width * height`` bytes, row by row.
        width: of the picture [px].
        height: of the picture [px].
        data: the payload.

    Returns:
        (height, width) of uint8. For ``grey`` it is a read-only view of ``data``.

    Raises:
        MessageError: another encoding, bytes that are not a complete JPEG, or a picture of another size.
    """
    if encoding == "grey":
        if len(data) != width * height:
            raise MessageError(
                f"a grey frame of {len(data)} bytes, expected {width} x {height} = {width * height}: "
                "one byte per pixel, without padding"
            )
        return np.frombuffer(data, dtype=np.uint8).reshape(height, width)
    if encoding != "jpeg":
        raise MessageError(f"a frame in {encoding!r}, expected 'jpeg' or 'grey'")
    size = jpeg_size(data)
    # Check before decoding: a few bytes can claim a picture of gigabytes.
    if size != (width, height):
        raise MessageError(f"a JPEG of {size[0]} x {size[1]} pixels, expected {width} x {height} as its message says")
    if data.rfind(b"\xff\xd9", -64) < 0:
        # OpenCV would fill the missing part with grey, and the robots in it would be missed.
        raise MessageError(f"a JPEG of {len(data)} bytes that is truncated, expected an end marker")
    try:
        picture = cv2.imdecode(np.frombuffer(data, dtype=np.uint8), cv2.IMREAD_GRAYSCALE)
    except cv2.error as error:
        raise MessageError(f"a JPEG of {len(data)} bytes that cannot be decoded: {error}") from error
    if picture is None or picture.shape != (height, width):
        raise MessageError(f"a JPEG of {len(data)} bytes that cannot be decoded to {width} x {height} pixels")
    return np.asarray(picture, dtype=np.uint8)


def jpeg_size(data: bytes) -> tuple[int, int]:
    """Width and height [px] in a JPEG's frame header.

    Args:
        data: a JPEG (ITU T.81, annex B).

    Raises:
        MessageError: not a JPEG.
    """
    if data[:2] != b"\xff\xd8":
        raise MessageError(f"a frame that starts with {data[:2].hex() or 'nothing'}, expected ffd8: a JPEG")
    at = 2
    while at + 9 <= len(data) and data[at] == 0xFF:
        marker = data[at + 1]
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = int.from_bytes(data[at + 5 : at + 7]), int.from_bytes(data[at + 7 : at + 9])
            return width, height
        if marker == 0xFF:  # fill byte
            at += 1
            continue
        at += 2 + int.from_bytes(data[at + 2 : at + 4])
    raise MessageError(f"a JPEG of {len(data)} bytes without a frame header")
