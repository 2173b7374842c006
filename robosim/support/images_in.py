"""Images from files, opened by Pillow: the size that a header declares is checked before anything is unpacked.

For use inside of `robosim.support.reading.reading`, which adds the file's name to what is raised.
"""

import io
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

from PIL import Image, UnidentifiedImageError

#: What is read: Pillow knows some forty more, of which some call other programs.
FORMATS = ("PNG", "PPM", "BMP", "TIFF", "GIF", "JPEG", "WEBP")


@contextmanager
def opened_image(
    content: bytes, most_pixels: int, formats: tuple[str, ...] = FORMATS
) -> Iterator[Image.Image]:
    """An image, loaded, of at most so many pixels.

    Raises:
        ValueError: If it is of another format, or too large.
        Exception: Whatever damaged content makes its decoder raise.
    """
    with silenced():
        try:
            image = Image.open(io.BytesIO(content), formats=formats)
        except UnidentifiedImageError as error:
            raise ValueError(f"of unknown format, expected {', '.join(formats)}") from error
        width, height = image.size
        if not 0 < width * height <= most_pixels:
            raise ValueError(f"{width} x {height} pixels, expected at most {most_pixels:.2g} in all")
        image.load()
    with image:
        yield image


@contextmanager
def silenced() -> Iterator[None]:
    """Suppress standard error, to which decoders in C print what they also return."""
    sys.stderr.flush()
    stderr, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 2)
    try:
        yield
    finally:
        os.dup2(stderr, 2)
        os.close(stderr)
        os.close(nowhere)
