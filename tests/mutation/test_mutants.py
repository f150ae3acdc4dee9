"""Changes are those that are named, one at a time, and what they make is a program."""

import ast

import pytest
from tests.mutation.mutants import changed_text, mutants_of, mutants_of_c

PYTHON = '''
def f(x: int = 3) -> float:
    """Say 1 + 1."""
    if x > 2 and not x == 5:
        go(x)
    for a, b in zip(x, x, strict=True):
        raise ValueError(f"{a + b} is {x > 2}")
    return -x if x < 1 else x @ x
'''

C = """
#define N 3 + 1 /* 1 + 1 */
static int f(int x)
{
    /* x + 1 */
    return x < 0 ? x + 1 : x;
}
"""


def test_changes_of_python(tmp_path):
    file = tmp_path / "f.py"
    file.write_text(PYTHON)
    found = mutants_of(file)
    assert {m.change for m in found} == {
        *("3 is 4", "2 is 3", "5 is 6", "1 is 2", "Gt is GtE", "Eq is NotEq", "Lt is LtE"),
        *("and is or", "not is gone", "minus is gone", "MatMult is Add", "a call is gone"),
        *("the condition never holds", "the condition always holds"),
    }
    same = ast.unparse(ast.parse(PYTHON))
    texts = [changed_text(m) for m in found]
    for text in texts:
        before, after = same.splitlines(), text.splitlines()
        assert len(before) == len(after)
        assert sum(one != other for one, other in zip(before, after, strict=True)) == 1
    assert len(set(texts)) == len(texts)


def test_changes_of_c(tmp_path):
    file = tmp_path / "f.c"
    file.write_text(C)
    found = mutants_of_c(file)
    assert sorted(m.change for m in found) == [
        "'+' is '-'",
        "'0' is '1'",
        "'1' is '2'",
        "'<' is '<='",
    ]
    for mutant in found:
        before, after = C.splitlines(), changed_text(mutant).splitlines()
        differing = [k for k, (a, b) in enumerate(zip(before, after, strict=True)) if a != b]
        assert differing == [mutant.line - 1] == [5]


@pytest.mark.parametrize("code", ["x = 1", "x = 'a' + 'b'", "assert x + 1 == 2"])
def test_what_says_something_stays(code, tmp_path):
    file = tmp_path / "f.py"
    file.write_text(code)
    assert {m.change for m in mutants_of(file)} <= {"1 is 2"}
