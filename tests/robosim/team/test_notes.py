"""Notes that robots of a team exchange."""

import numpy as np

from robosim.team.notes import Notebook


def _pass_on(sender: Notebook, receiver: Notebook) -> int:
    notes = list(sender.news_for(receiver, "tile"))
    for note in notes:
        receiver.receive(note)
    return len(notes)


def test_notebook_content_is_a_copy() -> None:
    author, reader = Notebook("a"), Notebook("b")
    values = np.arange(5)
    author.write("tile", values)
    values[:] = 0
    (note,) = author.news_for(reader, "tile")
    assert note.read().tolist() == [0, 1, 2, 3, 4]


def test_notebook_later_edition_replaces_earlier() -> None:
    author, reader = Notebook("a"), Notebook("b")
    author.write("tile", "first", (1, 2))
    assert _pass_on(author, reader) == 1
    assert _pass_on(author, reader) == 0
    author.write("tile", "second", (1, 2))
    assert _pass_on(author, reader) == 1
    (note,) = reader.news_for(Notebook("c"), "tile")
    assert (note.read(), note.edition) == ("second", 2)


def test_notebook_passes_on_notes_of_others_but_not_to_their_author() -> None:
    a, b, c = Notebook("a"), Notebook("b"), Notebook("c")
    a.write("tile", "from a")
    _pass_on(a, b)
    assert _pass_on(b, a) == 0
    assert _pass_on(b, c) == 1
    # It has it from b already.
    assert _pass_on(a, c) == 0
