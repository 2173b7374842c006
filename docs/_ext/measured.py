"""Tables and numbers of the results pages, made from docs/results/data when the site is built.

```{measured} search median          the table `median` of search.json, and the command that measured it
:rows: fused; snr                    only these rows
:columns: easy; hard                 only these columns
```

{number}`search/median/fused/easy`   one number in a sentence: file/table/row/name
"""

from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective, SphinxRole

from tests.benchmarks.results import DATA, markdown, read_results, resolved


def setup(app: Sphinx) -> dict[str, bool]:
    """Add the directive and the role."""
    app.add_directive("measured", Measured)
    app.add_role("number", Number())
    return {"parallel_read_safe": True, "parallel_write_safe": True}


class Measured(SphinxDirective):
    """One table of a file; below the first of several, a line with the command, commit, date and processor."""

    required_arguments = 2
    final_argument_whitespace = True
    option_spec: ClassVar[dict[str, Any]] = {"rows": directives.unchanged, "columns": directives.unchanged}

    def run(self) -> list[nodes.Node]:
        """The nodes."""
        name, table = self.arguments[0], self.arguments[1]
        self.env.note_dependency(str(DATA / f"{name}.json"))
        results = read_results(name)
        head, *lines = results.table(table)
        columns = [
            0,
            *(i for i, word in enumerate(head) if i and self._is_wanted("columns", word.split(" [")[0])),
        ]
        lines = [line for line in lines if self._is_wanted("rows", line[0])]
        cells = [[line[i] for i in columns] for line in [head, *lines]]
        document = self.state.document
        if getattr(document, "measured", "") == name:
            return self.parse_text_to_nodes("\n".join(markdown(cells)))
        document.measured = name
        about = results.about
        source = (
            f"`{about['command']}`, measured at {about['commit']}, {about['date']}; {about['processor']}."
        )
        text = "\n".join([*markdown(cells), "", source])
        return self.parse_text_to_nodes(text)

    def _is_wanted(self, option: str, word: str) -> bool:
        wanted = self.options.get(option)
        return wanted is None or word in [one.strip() for one in wanted.split(";")]


class Number(SphinxRole):
    """One number."""

    def run(self) -> tuple[list[nodes.Node], list[nodes.system_message]]:
        """Its text."""
        self.env.note_dependency(str(DATA / f"{self.text.split('/')[0]}.json"))
        return [nodes.Text(resolved(f"{{{self.text}}}"))], []
