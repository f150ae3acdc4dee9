"""Descriptions: frozen dataclasses that are checked when they are built, and print as trees.

The annotation of a field says what it may be, `Literal` for words, `Annotated` with a `Range` for
numbers; `Description` checks every field against it and tells all that is wrong at once.
`checked` does the same for the arguments of a function.
"""

from backsight.description._alike import alike
from backsight.description._arguments import checked
from backsight.description._base import Description, Sound
from backsight.description._content import Kept, content, digest
from backsight.description._docstring import first_sentence, meanings_of, without_marks
from backsight.description._fits import fault
from backsight.description._html import equations_of, page_of, preformatted
from backsight.description._ranges import (
    Called,
    Count,
    Distinct,
    Horizon,
    Lag,
    Level,
    NonNegative,
    Positive,
    PositiveOrInfinite,
    Range,
    Share,
    Unlimited,
    Whole,
)
from backsight.description._says import described, plain, words
from backsight.description._tree import Printed, short, tree

__all__ = [
    "Called",
    "Count",
    "Description",
    "Distinct",
    "Horizon",
    "Kept",
    "Lag",
    "Level",
    "NonNegative",
    "Positive",
    "PositiveOrInfinite",
    "Printed",
    "Range",
    "Share",
    "Sound",
    "Unlimited",
    "Whole",
    "alike",
    "checked",
    "content",
    "described",
    "digest",
    "equations_of",
    "fault",
    "first_sentence",
    "meanings_of",
    "page_of",
    "plain",
    "preformatted",
    "short",
    "tree",
    "without_marks",
    "words",
]
