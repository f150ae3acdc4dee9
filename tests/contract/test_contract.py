"""Every estimator keeps every promise of `backsight.testing`."""

import pytest

from backsight.estimators import ESTIMATORS
from backsight.testing import CASES, CHECKS, ENGINES, Subject


def test_every_estimator_has_a_case():
    assert set(CASES) == set(ESTIMATORS)
    assert all(key == estimator.key for key, estimator in ESTIMATORS.items())


SUBJECTS = [
    pytest.param(check, Subject(case, engine, hold), id=f"{check.name}-{key}-{hold}-{engine}")
    for key, case in CASES.items()
    for hold in ("zoh", "foh")
    for check in CHECKS
    for engine in (ENGINES if check.both_engines else ["vm"])
    if check.applies(Subject(case, engine, hold))
]


@pytest.mark.parametrize(("check", "subject"), SUBJECTS)
def test_contract(check, subject):
    check.run(subject)
