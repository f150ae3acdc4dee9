"""Check an estimator of one's own against the contract."""

import dataclasses
from collections.abc import Collection, Mapping
from typing import Any

from backsight.discrete.runge_kutta import Integrator
from backsight.estimators.base import AbstractEstimator
from backsight.testing.case import Case, Engine, Hold, Subject
from backsight.testing.checks import CHECKS, Check
from backsight.testing.close import ContractError
from backsight.testing.problem import TrialProblem


def check_estimator(
    estimator: type[AbstractEstimator] | AbstractEstimator,
    *,
    linear: bool = False,
    outputs: tuple[str, ...] = ("position", "speed"),
    exact: bool = False,
    expected_failures: Mapping[str, str] | None = None,
    engines: Collection[Engine] = ("vm", "native"),
    holds: Collection[Hold] = ("zoh", "foh"),
) -> None:
    """Check that an estimator keeps every promise that the rest of the package relies on.

    It has to follow an oscillator with an unknown stiffness: honest covariances, units, scales,
    missing samples, bounds, breakdown, streams, both engines. It takes a few seconds.

    Parameters
    ----------
    estimator : subclass of AbstractEstimator, or one of it
        A class is made with noise and prior only; give one with settings if that does not suit the
        problem. Noise, prior, and integrator or hold, are replaced by those of the problem.
    linear : bool
        The stiffness is given: for estimators of linear models, or of states only.
    outputs : tuple of str
        What is measured: "position" and "speed", or the first of them.
    exact : bool
        The estimator carries linear models over exactly, not by an integrator.
    expected_failures : dict, optional
        Name of a check to the reason for which it fails. A check that does not fail after all is
        reported, too.
    engines, holds : collections of str
        Restrict the check to some of them.

    Raises
    ------
    AssertionError
        With all that is broken: the promise, where it is broken, and by how much.

    Examples
    --------
    >>> from backsight import EKF
    >>> check_estimator(EKF, engines=["vm"], holds=["zoh"])
    """
    name = estimator.__name__ if isinstance(estimator, type) else type(estimator).__name__
    expected = dict(expected_failures or {})
    unknown = sorted(set(expected) - {check.name for check in CHECKS})
    if unknown:
        raise ValueError(f"there are no checks {', '.join(unknown)}")
    problems = _described(estimator)
    if problems:
        raise ContractError(f"{name} is no estimator:\n" + "\n".join(f"  {p}" for p in problems))
    case = Case(
        lambda on, integrator: _made(estimator, on, integrator),
        k_known=linear or exact,
        outputs=outputs,
        exact=exact,
    )
    for hold in holds:
        try:
            Subject(case, hold=hold).recursion()
        # Somebody else's estimator may fail in any way.
        except Exception as error:
            raise ContractError(
                f"{name} cannot be compiled ({hold}): {type(error).__name__}: {error}"
            ) from error
    lines, tried, count = [], 0, 0
    for check in CHECKS:
        subjects = [
            Subject(case, engine, hold)
            for hold in holds
            for engine in (engines if check.both_engines else list(engines)[:1])
        ]
        found = [(on, _broken(check, on)) for on in subjects if check.applies(on)]
        broken: dict[str, list[str]] = {}
        for on, reason in found:
            if reason:
                broken.setdefault(reason, []).append(f"{on.engine} {on.hold}")
        tried += bool(found)
        if check.name in expected and (broken or not found):
            continue
        if check.name in expected:
            lines.append(f"  {check.name}: is kept, although a failure is expected")
        elif broken:
            lines.append(f"  {check.name}: {check.promise}")
            lines += [f"    {', '.join(where)}: {reason}" for reason, where in broken.items()]
        count += check.name in expected or bool(broken)
    if lines:
        raise ContractError(f"{name} breaks {count} of {tried} promises:\n" + "\n".join(lines))


def _described(estimator: type[AbstractEstimator] | AbstractEstimator) -> list[str]:
    """What is wrong before anything is estimated."""
    kind = estimator if isinstance(estimator, type) else type(estimator)
    if not issubclass(kind, AbstractEstimator):
        return ["it is not derived from AbstractEstimator"]
    problems = []
    for word, meaning in (("key", "its name in problem files"), ("title", "the method's name")):
        if not isinstance(getattr(kind, word, None), str):
            problems.append(f"it has no '{word}', {meaning}: {word}: ClassVar[str] = ...")
    if "__dataclass_params__" not in vars(kind) or not vars(kind)["__dataclass_params__"].frozen:
        problems.append("it is no frozen dataclass: @dataclasses.dataclass(frozen=True)")
    else:
        fields = {f.name for f in dataclasses.fields(kind)}
        problems += [f"it has no field '{n}'" for n in ("noise", "prior") if n not in fields]
    return problems


def _made(
    estimator: type[AbstractEstimator] | AbstractEstimator, on: TrialProblem, integrator: Integrator
) -> AbstractEstimator:
    fields = {f.name for f in dataclasses.fields(estimator)}
    given: dict[str, Any] = {"noise": on.noise, "prior": on.prior}
    if "integrator" in fields:
        given["integrator"] = integrator
    elif "hold" in fields:
        given["hold"] = integrator.hold
    if isinstance(estimator, type):
        return estimator(**given)
    return dataclasses.replace(estimator, **given)


def _broken(check: Check, on: Subject) -> str:
    """What a check finds, or nothing."""
    try:
        check.run(on)
    except AssertionError as error:
        return str(error)
    # Somebody else's estimator may fail in any way; the other checks go on.
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return ""
