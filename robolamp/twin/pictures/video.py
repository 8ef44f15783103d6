"""Pictures in a row as a file: an animated GIF, or an MP4 with the extra `video`."""

from __future__ import annotations

import io
from collections.abc import Sequence
from fractions import Fraction
from types import ModuleType

import numpy as np
from PIL import Image

from robolamp.errors import RobolampError
from robolamp.twin.pictures.render import Picture

_QUALITY = "20"  # x264's constant rate factor: below 23 compression is hard to see (FFmpeg's H.264 guide)


def gif(pictures: Sequence[Picture], period: float) -> bytes:
    """Return an animated GIF that repeats for ever.

    Args:
        pictures: At least one, all of one size.
        period: Time between two of them [s], in whole hundredths: the format has no finer time.
    """
    stream = io.BytesIO()
    first, *others = (Image.fromarray(picture) for picture in pictures)
    first.save(stream, "GIF", save_all=True, append_images=others, duration=1000 * period, loop=0)
    return stream.getvalue()


def encoders() -> ModuleType:
    """Return the library that writes videos, PyAV.

    Raises:
        RobolampError: The extra `video` is not installed.
    """
    try:
        import av  # noqa: PLC0415 (the extra `video`)
    except ImportError:
        raise RobolampError(
            "MP4 needs the extra `video`: pip install 'robolamp[video]'; or write .gif", "video"
        ) from None
    return av


def mp4(pictures: Sequence[Picture], period: float) -> bytes:
    """Return an MP4 with H.264 video, which browsers, phones and slides play.

    Args:
        pictures: At least one, all of one size; an odd last row or column is cut off.
        period: Time between two of them [s].

    Raises:
        RobolampError: The extra `video` is not installed.
    """
    av = encoders()
    height, width = (side // 2 * 2 for side in pictures[0].shape[:2])  # the colours have half the resolution
    stream = io.BytesIO()
    with av.open(stream, "w", format="mp4") as file:
        track = file.add_stream("libx264", rate=Fraction(1 / period).limit_denominator(1000), options={"crf": _QUALITY})
        track.width, track.height, track.pix_fmt = width, height, "yuv420p"
        for picture in pictures:
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture[:height, :width]), format="rgb24")
            file.mux(track.encode(frame))
        file.mux(track.encode())
    return stream.getvalue()
