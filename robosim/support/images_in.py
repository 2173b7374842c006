"""Pictures from outside, opened by Pillow: what a header declares is held against bounds before anything is unpacked.

For use inside of `robosim.support.reading.reading`, which adds the file's name to what is raised.
"""

import io
from collections.abc import Iterator
from contextlib import contextmanager

from PIL import Image, UnidentifiedImageError

#: What is read: Pillow knows some forty more, of which some call other programs.
FORMATS = ("PNG", "PPM", "BMP", "TIFF", "GIF", "JPEG", "WEBP")


@contextmanager
def opened_image(
    content: bytes, most_pixels: int, formats: tuple[str, ...] = FORMATS
) -> Iterator[Image.Image]:
    """A picture, loaded, of at most so many pixels.

    Raises:
        ValueError: If it is none, or too large.
        Exception: Whatever damaged content makes its decoder raise.
    """
    try:
        image = Image.open(io.BytesIO(content), formats=formats)
    except UnidentifiedImageError as error:
        raise ValueError(f"of unknown format, expected {', '.join(formats)}") from error
    with image:
        width, height = image.size
        if not 0 < width * height <= most_pixels:
            raise ValueError(f"{width} x {height} pixels, expected at most {most_pixels:.2g} in all")
        image.load()
        yield image
