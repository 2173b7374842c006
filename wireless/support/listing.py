"""The first rows of a long table to look at: as text, and as HTML for notebooks."""

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

#: Rows that are shown; the others are counted.
MOST_ROWS = 20


@dataclass(frozen=True, kw_only=True)
class Listing:
    """Rows of a table to show, and how many there are."""

    title: str
    """Line above the table."""
    heads: tuple[str, ...]
    """Names of the columns, with units."""
    rows: Sequence[tuple[str, ...]]
    """Cells of the first rows, at most `MOST_ROWS`."""
    n_rows: int
    """Rows of the whole table."""

    @property
    def rest(self) -> str:
        """Return the line below: how many rows are not shown, if any."""
        left_out = self.n_rows - len(self.rows)
        return f"... and {left_out} more" if left_out else ""

    def text(self) -> str:
        """Title, heads and rows as lines of text, columns flush right."""
        lines = [self.heads, *self.rows] if self.rows else []
        widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
        aligned = [
            "  ".join(f"{cell:>{width}}" for cell, width in zip(line, widths, strict=True)) for line in lines
        ]
        return "\n".join(line for line in (self.title, *aligned, self.rest) if line)

    def html(self) -> str:
        """Return an HTML table; the cells are escaped text."""
        head = "".join(f"<th>{escape(name)}</th>" for name in self.heads)
        rows = "".join(
            "<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in self.rows
        )
        foot = f"<p>{escape(self.rest)}</p>" if self.rest else ""
        return (
            f"<table><caption>{escape(self.title)}</caption><thead><tr>{head}</tr></thead>"
            f"<tbody>{rows}</tbody></table>{foot}"
        )
