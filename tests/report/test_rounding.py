import math

import pytest

from backsight.rounding import grouped, percent, plus_minus, shortest, significant


@pytest.mark.parametrize(
    ("value", "std", "text"),
    [
        (95.109, 0.12, "95.11 ± 0.12"),
        (6.02e6, 1.2e4, "(6.020 ± 0.012) × 10⁶"),
        (-3.165, 0.0123, "−3.165 ± 0.012"),
        (99.96, 0.0996, "99.96 ± 0.10"),
        (70.0, 1000.0, "(0.1 ± 1.0) × 10³"),
        (0.0, 0.1, "0.00 ± 0.10"),
        (0.00361505, 2.4e-7, "(3.61505 ± 0.00024) × 10⁻³"),
        (5.375e-6, 2e-8, "(5.375 ± 0.020) × 10⁻⁶"),
        (1e6, 1e-5, "1.0000000 × 10⁶ ± 1.0 × 10⁻⁵"),
        (3.2, math.nan, "3.200"),
        (3.2, 0.0, "3.200"),
        (math.nan, 1.0, "–"),
        (-math.inf, 1.0, "−∞"),
    ],
)
def test_value_and_deviation(value, std, text):
    assert plus_minus(value, std) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.00099996, "0.001000"),
        (999999.6, "1.000 × 10⁶"),
        (123456.0, "123456"),
        (-4.2e-9, "−4.200 × 10⁻⁹"),
        (0.0, "0"),
        (12.0, "12.00"),
    ],
)
def test_significant_digits(value, text):
    assert significant(value) == text


def test_other_numbers():
    assert shortest(203.50) == "203.5"
    assert shortest(-3.165) == "−3.165"
    assert shortest(5.4e-7) == "5.4 × 10⁻⁷"
    assert shortest(math.nan) == "–"
    assert grouped(24841) == "24\N{NARROW NO-BREAK SPACE}841"
    assert percent(0.0032) == "+0.32 %"
    assert percent(-0.12) == "−12 %"
    assert percent(math.nan) == "–"
