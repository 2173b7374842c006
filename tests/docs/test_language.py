"""Code and documentation use standard terms: words that the project replaces do not occur.

Documentation is checked in prose and in Python blocks, without inline code and printed output. Code is checked in
identifiers (words between underscores and capitals), comments and strings. A string on a line with the comment
`stored name` is part of a file format. Names that functions, classes and modules bind say what they hold.
"""

import ast
import io
import re
import tokenize
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("robosim", "slam", "wireless")

#: Words, as regular expressions, and what to write instead.
WORDS = {
    "tell|tells|told|telling|untold": "classify, report, print, show, document; unknown",
    "ways?": "path, route, trajectory; method",
    "anew": "again, from scratch",
    "beside": "next to, in addition to, compared with",
    "who(m|so)?ever": "name the actor",
    "hear|hears|heard|hearing": "receive, received, measured, above threshold",
    "gone": "arc length, step length, removed",
    "kept": "cached, stored, unchanged",
    "dwell|dwells|dwelled|dwelling": "stay; stuck detector",
    "onlookers?": "observer, callback",
    "dearer": "slower, more expensive",
    "foreseen": "supported",
    "elsewhere": "on other systems, in other places",
    "balls?": "spheres",
    "reckon|reckons|reckoned": "compute, estimate",
    "nobody": "no one, none; name the actor",
    "lest": "so that ... not",
    "invented": "generated",
    "refuse|refuses|refused|refusing|refusals?": "reject, raise an error",
    "wants": "needs, requires",
    "aught|naught|thereof|therein|hitherto|henceforth": "plain words",
}
PHRASES = {
    r"for good(?! reason)": "permanently",
    r"no longer": "state what is current",
    r"since then": "state what is current",
    r"as it is now": "state what is current",
    r"to the (last )?bit": "bit-identical",
    r"numbers that are none": "NaN or infinite",
    r"(take|takes|took|taken|taking) for": "treat as",
    r"(hold|holds|held|holding)( \w+)? against": "compare with",
    r"(look|looks|looked|looking) back (on|at)": "replay",
    r"by all together": "with all sensors combined",
    r"licence form": "registration form",
    r"(search|searches|searched|searching) (a|the) (target|transmitter)": "search for",
    r"(hands?|takes?|took|taken|taking) over": "fall back to, hand control to",
    r"made homes|made floors": "generated",
    r"let(s|ting)? through": "passes, transmits",
    r"now and then": "occasionally",
    r"(ask|asks|asked|asking) (for|of)": "needs, requires",
}
#: Names of values, which are nouns, and functions, which are verbs: no participles.
IDENTIFIERS = {"moved", "asked", "told", "described", "restored"}
#: Names that do not say what they hold: `part` is a replaceable part only.
VAGUE = {"found", "given", "looks", "most", "one", "own", "part", "some", "worth"}
#: Where these names remain: folders and files as prefixes, and the names.
VAGUE_ALLOWED: dict[str, set[str]] = {
    "robosim/support/parts.py": {"part"},  # a replaceable part
}
#: Names of other libraries.
FOREIGN = {"query_ball_point"}

PATTERN = re.compile(rf"\b(?:{'|'.join(WORDS)}|{'|'.join(PHRASES)})\b", re.IGNORECASE)
_WORD = re.compile(rf"(?:{'|'.join(WORDS)})", re.IGNORECASE)

_GENERATED = {"_build", "_static", "examples", "commands", "api"}


def pages() -> list[Path]:
    """Pages that are written by hand."""
    files = [ROOT / "README.md", ROOT / "CHANGELOG.md", ROOT / "CONTRIBUTING.md", ROOT / "SECURITY.md"]
    files += [ROOT / "paper.md", ROOT / "assets" / "LICENSES.md"]
    files += [
        path
        for suffix in ("md", "rst")
        for path in sorted((ROOT / "docs").rglob(f"*.{suffix}"))
        if not _GENERATED & set(path.relative_to(ROOT).parts)
    ]
    return files


def sources() -> list[Path]:
    """Python files of packages, tests and examples."""
    files = [
        path
        for folder in ("docs", "robosim", "scripts", "slam", "tests", "wireless")
        for path in sorted((ROOT / folder).rglob("*.py"))
        if not (folder == "docs" and _GENERATED & set(path.relative_to(ROOT).parts))
    ]
    return [path for path in files if path != Path(__file__).resolve()]


def prose(text: str) -> Iterator[tuple[int, str]]:
    """Numbered lines of a page without inline code, references, tables of names, output and other blocks of code."""
    language: str | None = None
    in_names = False
    for number, line in enumerate(text.splitlines(), 1):
        if line.startswith("#"):
            in_names = line.strip("# ").lower().startswith("names")
        fence = re.match(r"\s*(`{3,}|:{3,})(\{?[\w-]*)", line)
        if fence and fence[1][0] == "`" and language is not None:
            language = None
        elif fence and fence[1][0] == "`":
            language = fence[2]
        elif is_prose(language, line) and not in_names:
            yield number, re.sub(r"`[^`]*`|\]\([^)]*\)|\{cite\}|^:\w+:.*$", " ", line)


def is_prose(language: str | None, line: str) -> bool:
    """Whether a line is text, in a directive too, a command, or Python that is not printed output."""
    if language is None or language == "console" or language.startswith("{"):
        return True
    return language == "python" and is_code(line)


def is_code(line: str) -> bool:
    """Whether a line of a Python block is not printed output."""
    return not re.match(r"\s*(tx  rx|\d+ paths?,|\d+ +\d+ )", line)


def wrong_lines(path: Path) -> list[str]:
    """Places of a file with a word to replace."""
    text = path.read_text("utf-8")
    name = path.relative_to(ROOT).as_posix()
    if path.suffix != ".py":
        words = [(number, match[0]) for number, line in prose(text) for match in PATTERN.finditer(line)]
    else:
        words = list(wrong_tokens(text))
    return [f"{name}:{number}: '{word}', say: {instead(word)}" for number, word in words]


def wrong_tokens(text: str) -> Iterator[tuple[int, str]]:
    """Words to replace in identifiers, comments and strings."""
    lines = text.splitlines()
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        number = token.start[0]
        if token.type == tokenize.STRING and lines[number - 1].endswith("# stored name"):
            continue
        if token.type == tokenize.NAME and token.string not in FOREIGN:
            for word in words_of(token.string):
                if _WORD.fullmatch(word) or token.string in IDENTIFIERS:
                    yield number, token.string
                    break
        elif (
            token.type in (tokenize.COMMENT, tokenize.STRING)
            or "FSTRING_MIDDLE" in tokenize.tok_name[token.type]
        ):
            for match in PATTERN.finditer(token.string):
                yield number + token.string[: match.start()].count("\n"), match[0]


def words_of(name: str) -> list[str]:
    """Words of an identifier."""
    return [word for piece in name.split("_") for word in re.findall(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])", piece)]


def vague_names(text: str) -> Iterator[tuple[int, str]]:
    """Bound names of a module that do not say what they hold: variables, parameters, members, functions, imports."""
    for node in ast.walk(ast.parse(text)):
        names = []
        if isinstance(node, ast.Name | ast.Attribute) and isinstance(node.ctx, ast.Store):
            names = [node.id if isinstance(node, ast.Name) else node.attr]
        elif isinstance(node, ast.arg):
            names = [node.arg]
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            names = [node.name]
        elif isinstance(node, ast.alias):
            names = [node.asname or node.name]
        elif isinstance(node, ast.ExceptHandler | ast.MatchAs | ast.MatchStar) and node.name:
            names = [node.name]
        elif isinstance(node, ast.MatchMapping) and node.rest:
            names = [node.rest]
        yield from ((getattr(node, "lineno", 0), name) for name in names if name in VAGUE)


def is_vague_allowed(path: str, name: str) -> bool:
    """Whether `VAGUE_ALLOWED` has a name of a file."""
    return any(path.startswith(prefix) and name in names for prefix, names in VAGUE_ALLOWED.items())


def instead(word: str) -> str:
    """What to write for a word or an identifier."""
    for pattern, better in (WORDS | PHRASES).items():
        if re.fullmatch(pattern, word, re.IGNORECASE):
            return better
        if any(re.fullmatch(pattern, piece, re.IGNORECASE) for piece in words_of(word)):
            return better
    return "a noun or a verb"


@pytest.mark.parametrize("path", pages(), ids=lambda path: path.relative_to(ROOT).as_posix())
def test_pages_use_standard_terms(path: Path) -> None:
    """README, changelog and documentation."""
    assert not wrong_lines(path)


def test_code_uses_standard_terms() -> None:
    """Identifiers, docstrings, comments, help texts and messages."""
    assert not [line for path in sources() for line in wrong_lines(path)]


def test_names_say_what_they_hold() -> None:
    """Packages with their stubs, except for what `VAGUE_ALLOWED` lists."""
    wrong = []
    for path in sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py*")):
        place = path.relative_to(ROOT).as_posix()
        if path.suffix in (".py", ".pyi"):
            names = vague_names(path.read_text("utf-8"))
            wrong += [f"{place}:{line}: {name}" for line, name in names if not is_vague_allowed(place, name)]
    assert not wrong, "name the thing: candidate, visible_cells, fraction, component, n_max"


def test_vague_names_are_bound_names() -> None:
    """Every kind of binding counts; uses, keys and words within names do not."""
    bound = "found = 1\ndef f(own): self.part = [one for one in x]\nclass A:\n    most: int = 0\nfrom m import given\n"
    bound += "for k, some in x: pass\nlambda worth: 0\nmatch x:\n    case [looks]: pass\n"
    assert {name for _, name in vague_names(bound)} == VAGUE
    used = "n_found = found.most(own=1)\nx = {'part': one}\nalone = some[given]\n"
    assert not list(vague_names(used))


def test_words_are_found_in_prose_and_code() -> None:
    """Whole words and phrases, whatever the case; not in inline code, output, or inside other words."""
    page = "The ways it told.\n`ways.png` halfway\n```text\nway\n```\n```python\nway = 1\n```\n"
    page += "```{measured} way\n```\nAnew.\n"
    assert [(n, m[0]) for n, line in prose(page) for m in PATTERN.finditer(line)] == [
        (1, "ways"),
        (1, "told"),
        (7, "way"),
        (11, "Anew"),
    ]
    code = 'best_way = wayBack(x)  # kept\ndoorway = "To the\nBit"\nmoved = 2\n'.replace("the\n", "the ")
    assert [word for _, word in wrong_tokens(code)] == ["best_way", "wayBack", "kept", "To the Bit", "moved"]
