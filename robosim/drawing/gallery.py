"""A folder of pictures with captions, and one page that shows them all in a browser."""

import html
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from robosim.support.files import whole_file

_STYLE = (
    "body{font-family:sans-serif;max-width:70em;margin:2em auto;padding:0 1em;line-height:1.45}"
    "img{max-width:100%;border:1px solid #ddd}figure{margin:0 0 3em}figcaption{max-width:52em}"
)


@dataclass(frozen=True, kw_only=True)
class Picture:
    """One picture of a folder."""

    name: str
    """Of its file in the folder."""
    title: str
    """What it shows, in a few words."""
    caption: str
    """How to read it, and what it is to be compared with."""


def write_index(folder: Path, title: str, pictures: Sequence[Picture], notes: Sequence[str] = ()) -> Path:
    """Write index.html, which shows pictures with their captions.

    Args:
        folder: Where the pictures are.
        title: Of the page.
        pictures: In their order.
        notes: Said before them, such as what is missing and why.

    Returns:
        The file.
    """
    parts = [f"<h1>{html.escape(title)}</h1>", *(f"<p>{html.escape(note)}</p>" for note in notes)]
    for picture in pictures:
        name, head = html.escape(picture.name), html.escape(picture.title)
        parts += [
            f'<h2 id="{Path(name).stem}">{head}</h2>',
            f'<figure><img src="{name}" alt="{head}">',
            f"<figcaption>{html.escape(picture.caption)}</figcaption></figure>",
        ]
    page = "\n".join(
        [
            '<!doctype html><html lang="en"><head><meta charset="utf-8">',
            f"<title>{html.escape(title)}</title><style>{_STYLE}</style></head><body>",
            *parts,
            "</body></html>\n",
        ]
    )
    with whole_file(folder / "index.html") as partial:
        partial.write_text(page, encoding="utf-8")
    return folder / "index.html"
