"""What only other loops call is optimised where it is linked, if numba has the parts for that."""

import sys

import pytest

from tests.wireless.support.mini_package import edit, run


def machine_code():
    """Whether functions have machine code of their own: the one that another calls, and the one that calls it."""
    functions = (sys.modules["mini.parts.inner"].inner._part, sys.modules["mini.loops"].outer)
    made = [next(iter(function.overloads.values())).library for function in functions]
    return [any(not one.is_declaration for one in library._final_module.functions) for library in made]


def test_what_only_other_loops_call_is_linked_into_them(mini):
    """And has no machine code of its own."""
    assert run() == (1025.0, True)
    if not sys.modules["mini.linked"].works():
        pytest.skip("this version of numba has no such parts, or others")
    assert machine_code() == [False, True]


@pytest.mark.parametrize(
    ("part", "other"),
    [
        ('"JITCodeLibrary"', '"CodeLibraryOfAnotherName"'),
        ("_function_pass_manager(opt=_TIDY)", "_function_pass_manager(another_option=_TIDY)"),
        ("self._get_module_for_linking()", "self._another_method()"),
        ('"_ZN7cpython"', '"_ZN12another_name"'),
        ("template.context", "template.another_part"),
        ("options.fastmath", "options.another_option"),
    ],
)
def test_where_numba_has_other_parts_its_own_way_serves(mini, part, other):
    """Without a word; what is kept then serves as well where it has them, and the other way round."""
    edit(mini / "linked.py", part, other)
    assert run() == (1025.0, True)
    assert not sys.modules["mini.linked"].works()
    assert machine_code() == [True, True]
    edit(mini / "linked.py", other, part)
    assert run() == (1025.0, False)
    [kept] = (mini / "__pycache__").glob("mini.loops.outer-*.compiled")
    kept.unlink()
    assert run() == (1025.0, True)
    [kept] = (mini / "__pycache__").glob("mini.loops.outer-*.compiled")
    kept.unlink()
    edit(mini / "linked.py", part, other)
    assert run() == (1025.0, True)
