"""Files beyond all measure end in one line, at once and before memory is taken."""

import os
import time

import pytest

import small_problem
from backsight.errors import DataError, ProblemError
from backsight.problem import load
from backsight.problem.reading import _room as limits
from backsight.problem.recorded import recording_of

BEYOND = {
    "nested lists": ("reference.k = " + "[" * 10**4 + "]" * 10**4, "deep"),
    "nested tables": ("reference.k = " + "{a=" * 10**4 + "1" + "}" * 10**4, "deep"),
    "lists that can be read": ("x = " + "[" * 60 + "]" * 60, "more than 32 deep"),
    "dotted key": ("x." * 10**5 + "y = 1", "a key has more than 32 parts"),
    "dotted table": ("[" + "x." * 10**5 + "y]", "a key has more than 32 parts"),
    "digits": (
        "reference.z = " + "9" * 5000,
        "is not TOML: a number has thousands",
    ),
    "bits": ("x = " + "9" * 400, "whole number of 1329 bits"),
    "long key": ("a" * 10**6 + " = 1", "a key has 1000000 characters"),
    "long text": ('x = "' + "x" * 10**6 + '"', "x: has 1000000 characters"),
    "keys": ("".join(f"zz{k} = 1\n" for k in range(10**4)), "has 100.. entries; the limit is 2000"),
    "key that steers": ('"\\u001b[2J" = 1', "has control characters"),
}


@pytest.mark.parametrize(("more", "message"), BEYOND.values(), ids=BEYOND)
def test_beyond_measure(tmp_path, more, message):
    path = small_problem.write(tmp_path, f"{more}\n{small_problem.TEXT}")
    began = time.perf_counter()
    with pytest.raises(ProblemError, match=message) as caught:
        load(path)
    assert time.perf_counter() - began < 2.0
    assert len(str(caught.value)) <= 2000
    assert str(caught.value).isprintable()


def test_wide_matrices_and_dots_in_texts_are_fine():
    limits.check_keys("Q = [\n" + ("[" + "0.1, " * 500 + "0.1],\n") * 3 + "]\n")
    limits.check_keys("F = { a = [" + "0.1, " * 500 + "0.1], b = 1.0 }\n")
    limits.check_keys('title = "' + "..." * 100 + '"\n')
    limits.check_tree({"title": "a\nb\tc", "x": [[0.0] * 500] * 500})


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs pipes")
def test_what_is_no_file_is_not_opened(tmp_path):
    os.mkfifo(tmp_path / "pipe.toml")
    with pytest.raises(ProblemError, match="a device or a pipe"):
        load(tmp_path / "pipe.toml")
    with pytest.raises(ProblemError, match="a device or a pipe"):
        load("/dev/zero")
    with pytest.raises(ProblemError, match="is a folder"):
        load(tmp_path)
    for name in ("x" * 5000, "a\0b"):
        with pytest.raises(ProblemError, match="cannot read"):
            load(tmp_path / name)


def test_a_large_file_is_not_read(tmp_path):
    path = tmp_path / "large.toml"
    with path.open("wb") as file:
        file.truncate(limits.MOST_BYTES + 1)
    with pytest.raises(ProblemError, match="bytes; the limit is"):
        load(path)


@pytest.mark.parametrize(
    ("more", "key"),
    [
        ("[tune]\nfree = [{ nme = 'k' }]", r"tune\.free\.0\.nme: unknown key, did you mean 'name'"),
        ("[dummy]\nd = { expresion = 'q' }", r"dummy\.d\.expresion: .* mean 'expression'"),
        ("[dummy]\nd = [{ a = 1 }]", r"dummy\.d\."),
    ],
)
def test_unknown_keys_are_named_wherever_they_are(tmp_path, more, key):
    with pytest.raises(ProblemError, match=key):
        load(small_problem.write(tmp_path, f"{small_problem.TEXT}\n{more}\n"))


def test_what_is_wrong_with_a_path_of_thousands_of_characters_is_said(tmp_path):
    text = small_problem.changed('"spring.csv"', f'"{"x" * 5000}.csv"')
    with pytest.raises(DataError, match=r"x… \(cut: .* characters\) …x.*\.csv': \w+") as caught:
        recording_of(load(small_problem.write(tmp_path, text)))
    assert len(str(caught.value)) <= 2000


@pytest.mark.parametrize("kind", ["{ a = 1 }", "[1]", "1", "true"])
def test_a_kind_that_is_no_text_is_refused(tmp_path, kind):
    text = small_problem.changed('kind = "sdof"', f"kind = {kind}")
    with pytest.raises(ProblemError, match=r"model\.kind: must be text in quotes"):
        load(small_problem.write(tmp_path, text))
