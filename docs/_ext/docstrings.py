"""Docstrings as this project writes them, made fit for reStructuredText.

Names stand in single backticks, formulas in indented blocks, and stars, bars and trailing underscores mean themselves.
Runs before napoleon, which reads the sections (Args, Returns, Raises).
"""

import re

from docutils import nodes
from sphinx import addnodes
from sphinx.application import Sphinx

_SECTION = re.compile(r":returns:|(Args|Returns|Raises|Yields|Attributes|Example|Examples|Note):\s*$")
_ENTRY = re.compile(r"(\w+(?:, \w+)*): ")
_CODE = re.compile(r"(``.+?``|`[^`]+`)")
#: Words on constants and fields, by their names.
_PLAIN: dict[str, list[str]] = {}
#: Type of a field that holds a part, as autodoc writes it, with the whole registry.
_PART = re.compile(r"~?(?:typing\.)?Annotated\[~?(?:typing\.)?Any, .*?_action=None\)\]")
_LIST = re.compile(r"\s*([-*]|\d+\.) ")


def setup(app: Sphinx) -> dict[str, bool]:
    """Connect."""
    app.connect("autodoc-process-docstring", _process, priority=100)
    app.connect("autodoc-process-docstring", _restore, priority=900)
    app.connect("autodoc-process-signature", _short_types)
    app.connect("doctree-read", _short_parts)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _short_types(app, what, name, obj, options, signature, returned):
    """Shapes as the source has them: Float[ndarray, 'n 3'] rather than with the packages' names."""

    def short(text: str | None) -> str | None:
        if text is None:
            return None
        text = _PART.sub("str | object", text)
        text = re.sub(r"\b(?:jaxtyping|numpy|np|collections\.abc|pathlib|typing)\.", "", text)
        return re.sub(r"\[ndarray, '([^']*)'\]", lambda m: f"[ndarray, '{m[1].strip()}']", text)

    return short(signature), short(returned)


def _short_parts(app, doctree):
    """Fields that hold a part: the rest of the registry that the parser of annotations leaves."""
    for node in doctree.findall(addnodes.desc_annotation):
        if "<lambda>" in node.astext():
            node[:] = [addnodes.desc_sig_punctuation("", ":"), nodes.Text(" part")]


def _process(app, what, name, obj, options, lines):
    """Indented blocks become literal ones; in other lines special characters are escaped."""
    lines[:] = _with_returns(lines)
    out: list[str] = []
    section = table = False
    block = False
    for line in lines:
        indent = len(line) - len(line.lstrip())
        if not line.strip():
            out.append(line)
            continue
        if indent == 0:
            if block and out and out[-1]:
                out.append("")
            block = False
            section = bool(_SECTION.match(line))
        table = line.lstrip().startswith("|")
        if table and not section:
            if not block:
                out.extend(["", "::", ""])
                block = True
            out.append("    " + line)
            continue
        if indent and not section and not _LIST.match(line) and not _in_list(out):
            if not block:
                if out and out[-1]:
                    out.append("")
                out.extend(["::", ""])
                block = True
            out.append(line)
            continue
        block = False
        # A list right after a paragraph needs an empty line.
        if (
            _LIST.match(line)
            and indent == 0
            and out
            and out[-1]
            and not _LIST.match(out[-1])
            and not _in_list(out)
        ):
            out.append("")
        out.append(_escaped(line))
    lines[:] = out
    if what in ("attribute", "data"):
        _PLAIN[name] = out


def _with_returns(lines: list[str]) -> list[str]:
    """Returns as a field, its entries as a list: napoleon would take what stands before a colon for a type."""
    if "Returns:" not in lines:
        return lines
    first = lines.index("Returns:")
    last = first + 1
    while last < len(lines) and (not lines[last].strip() or lines[last].startswith("    ")):
        last += 1
    body = [line[4:] for line in lines[first + 1 : last] if line.strip()]
    entries = [line for line in body if not line.startswith(" ")]
    if len(entries) > 1 and all(_ENTRY.match(line) for line in entries):
        field = [":returns:"]
        for line in body:
            entry = _ENTRY.match(line)
            field.append(f"        - `{entry[1]}` – {line[entry.end() :]}" if entry else f"      {line}")
    else:
        field = [":returns:", *(f"        {line.strip()}" for line in body)]
    return [*lines[:first], *field, "", *lines[last:]]


def _restore(app, what, name, obj, options, lines):
    """What napoleon made of a constant's words, where it took what stands before a colon for a type."""
    if name in _PLAIN:
        lines[:] = _PLAIN.pop(name)


def _in_list(out: list[str]) -> bool:
    """Whether the paragraph that is being written is an item of a list."""
    for line in reversed(out):
        if not line.strip():
            return False
        if _LIST.match(line):
            return True
        if not line.startswith(" "):
            return False
    return False


def _escaped(line: str) -> str:
    parts = _CODE.split(line)
    for i in range(0, len(parts), 2):
        text = parts[i]
        if i == 0 and (match := _LIST.match(text)):
            head, text = match[0], text[match.end() :]
        else:
            head = ""
        text = re.sub(r"([*|\\])", r"\\\1", text)
        parts[i] = head + re.sub(r"(\w)_(?=\W|$)", r"\1\\_", text)
    for i in range(1, len(parts), 2):
        # What follows a name directly, as the plural's s, is separated from the markup.
        if parts[i + 1][:1].isalnum():
            parts[i + 1] = "\\ " + parts[i + 1]
        if not parts[i].startswith("``"):
            parts[i] = f"`{parts[i]}`"
    return "".join(parts)
