"""What the paper says of its observers, each statement decided by the measured numbers."""

import math
from collections.abc import Mapping, Sequence

from backsight.rounding import significant
from backsight_studies.claims import Claim
from backsight_studies.punch.evaluate import PARAMETERS
from backsight_studies.punch.experiment import Experiment, median
from backsight_studies.punch.plant import READINGS, STIFF, Reading
from backsight_studies.punch.scenarios import (
    ADAPTIVE,
    AHG,
    EKF,
    EKF1,
    EKF3,
    FAST,
    FIXED,
    JUMPS,
    STARTS,
    UKF,
    UKF1,
    UKF3,
    Scenario,
)

STIFF_START = next(s for s in STARTS if s.reading is STIFF and s.factor == 1.8)
NEAR_START = next(s for s in STARTS if s.reading is STIFF and s.factor == 1.2)

PAPER_LIKE, TUNED = "filters as in the paper, qx = 3", "tuned filters, qx = 0.01"
JUMPING = "filters with qx = 1"


def judge(experiment: Experiment) -> list[Claim]:
    """Decide every statement of section 4.4 to 4.6."""
    return [
        *_fastest(experiment),
        _starts(experiment),
        *_filters(experiment),
        _damping(experiment),
        _why_not(experiment),
        *_jumps(experiment),
        *_gains(experiment),
    ]


def times(experiment: Experiment, scenario: Scenario, label: str) -> dict[str, float]:
    """Median over the seeds of the convergence time of every parameter; NaN for "never"."""
    found = experiment.of(scenario, label)
    return {p: median([m.time[p] for m in found]) for p in PARAMETERS}


def slowest(time: Mapping[str, float]) -> float:
    """Time until all parameters have converged; infinite if one does not."""
    return max(math.inf if math.isnan(t) else t for t in time.values())


def seconds(time: float) -> str:
    """With three digits, or "never"."""
    return f"{significant(time, 3)} s" if math.isfinite(time) else "never"


def percent(share: float) -> str:
    """With two digits; what is below a ten-thousandth is 0."""
    return f"{significant(100 * share, 2)} %" if abs(share) >= 1e-4 else "0 %"


def _fastest(e: Experiment) -> list[Claim]:
    text = "The AHG converges faster than EKF and UKF: all three parameters"
    found = []
    for setting, labels in ((PAPER_LIKE, (FAST, EKF3, UKF3)), (TUNED, (FAST, EKF, UKF))):
        all_of = {label: slowest(times(e, STIFF_START, label)) for label in labels}
        ahg, *filters = all_of.values()
        shown = ", ".join(f"{label} {seconds(t)}" for label, t in all_of.items())
        found.append(Claim(text, f"stiff, 1.8 p, {setting}", ahg < min(filters), shown))
    return found


def _starts(e: Experiment) -> Claim:
    far, near = (slowest(times(e, s, FAST)) for s in (STIFF_START, NEAR_START))
    return Claim(
        "The start, 1.8 p or 1.2 p, does not considerably affect the convergence time of the AHG",
        "stiff",
        far < 2 * near,
        f"{seconds(far)} and {seconds(near)} for all three parameters",
    )


def _filters(e: Experiment) -> list[Claim]:
    ekf, ukf = times(e, STIFF_START, EKF3), times(e, STIFF_START, UKF3)
    pair = [t["c"] for t in (ekf, ukf)]
    return [
        Claim(
            "EKF and UKF find the stiffness at almost the same rate",
            f"stiff, 1.8 p, {PAPER_LIKE}",
            max(pair) < 1.5 * min(pair),
            f"EKF {seconds(pair[0])}, UKF {seconds(pair[1])}",
        ),
        Claim(
            "The UKF finds the mass faster than the EKF",
            f"stiff, 1.8 p, {PAPER_LIKE}",
            slowest({"m": ukf["m"]}) < slowest({"m": ekf["m"]}),
            f"UKF {seconds(ukf['m'])}, EKF {seconds(ekf['m'])}",
        ),
    ]


def _damping(e: Experiment) -> Claim:
    never = {
        label: sum(math.isnan(m.time["d"]) for m in e.of(STIFF_START, label))
        for label in (EKF3, UKF3)
    }
    count = len(e.of(STIFF_START, EKF3))
    return Claim(
        "EKF and UKF cannot identify the damping",
        f"stiff, 1.8 p, {PAPER_LIKE}",
        all(n == count for n in never.values()),
        ", ".join(f"{label} fails on {n} of {count} recordings" for label, n in never.items()),
    )


def _why_not(e: Experiment) -> Claim:
    tuned = times(e, STIFF_START, EKF)["d"]
    bias = {b.sensor_noise: b.bias for b in e.biases if b.speed_noise == 1.0}
    low, *_, high = sorted(bias)
    return Claim(
        "EKF and UKF miss the damping because the motion does not excite it enough",
        "stiff",
        math.isnan(tuned),
        f"the tuned EKF finds it from the same motion in {seconds(tuned)}; the EKF with qx = 1 "
        f"that starts at the truth is off by {percent(bias[low])} without sensor noise and by "
        f"{percent(bias[high])} with {1e6 * high:g} µm: the error is a bias from noise",
    )


def _jumps(e: Experiment) -> list[Claim]:
    found = []
    for setting, filters in ((JUMPING, (EKF1, UKF1)), (TUNED, (EKF, UKF))):
        for reading in READINGS:
            found.append(_faster_after_jumps(e, reading, setting, filters))
    own = {p: e.jump(STIFF, AHG, p).excursion for p in JUMPS}
    others = {p: max(v for q, v in own[p].items() if q != p) for p in JUMPS}
    worst = {label: e.jump(STIFF, label, "c").excursion for label in (AHG, EKF1)}
    mass = [e.jump(STIFF, label, "m").error["m"] for label in (EKF1, UKF1)]
    damping = [e.jump(STIFF, label, "d").time["d"] for label in (EKF1, UKF1)]
    return [
        *found,
        Claim(
            "One parameter jumps, and the others of the AHG move and come back",
            "stiff",
            max(others.values()) > 0.05,
            "largest error of another parameter "
            + ", ".join(f"{percent(v)} after {p}" for p, v in others.items()),
        ),
        Claim(
            "After the jump of the stiffness the damping of the AHG and the mass of the EKF are "
            "affected most",
            f"stiff, {JUMPING}",
            worst[AHG]["d"] > worst[AHG]["m"] and worst[EKF1]["m"] > worst[EKF1]["c"],
            f"AHG m {percent(worst[AHG]['m'])}, d {percent(worst[AHG]['d'])}; "
            f"EKF m {percent(worst[EKF1]['m'])}, d {percent(worst[EKF1]['d'])}, which is its bias",
        ),
        Claim(
            "EKF and UKF do not follow the jump of the damping",
            f"stiff, {JUMPING}",
            all(map(math.isnan, damping)),
            f"EKF {seconds(damping[0])}, UKF {seconds(damping[1])}",
        ),
        Claim(
            "EKF and UKF keep a small bias of the mass after its jump",
            f"stiff, {JUMPING}",
            all(0.001 < abs(v) < 0.02 for v in mass),
            f"EKF {percent(mass[0])}, UKF {percent(mass[1])}",
        ),
    ]


def _faster_after_jumps(
    e: Experiment, reading: Reading, setting: str, filters: Sequence[str]
) -> Claim:
    own = {
        label: {p: e.jump(reading, label, p).time[p] for p in JUMPS} for label in (AHG, *filters)
    }
    shown = "; ".join(
        f"{p}: " + ", ".join(f"{label} {seconds(t[p])}" for label, t in own.items()) for p in JUMPS
    )
    ahg = own.pop(AHG)
    holds = all(slowest({p: ahg[p]}) < slowest({p: t[p]}) for t in own.values() for p in JUMPS)
    text = "After each jump the AHG follows faster than EKF and UKF"
    return Claim(text, f"{reading.name}, {setting}", holds, shown)


def _gains(e: Experiment) -> list[Claim]:
    found = []
    for reading in READINGS:
        ratio, slower = quieter(e, reading), longer(e, reading)
        rise = max(g.rise for g in e.gain(reading, ADAPTIVE))
        found.append(
            Claim(
                "The adaptive gain lowers the noise of the stiffness without enlarging the "
                "response time",
                reading.name,
                max(ratio) < 1 and max(slower) <= 1.5,
                f"noise {min(ratio):.3f} to {max(ratio):.3f} of that with fixed gain, response "
                f"{min(slower):.2f} to {max(slower):.2f} times as long; the gain is at 90 % of its "
                f"upper limit after {1e3 * rise:.0f} ms",
            )
        )
    return found


def quieter(e: Experiment, reading: Reading) -> list[float]:
    """Noise of the stiffness with adaptive gain per that with fixed gain, for every seed."""
    pairs = zip(e.gain(reading, ADAPTIVE), e.gain(reading, FIXED), strict=True)
    return [a.std["c"] / f.std["c"] for a, f in pairs]


def longer(e: Experiment, reading: Reading) -> list[float]:
    """Response time with adaptive gain per that with fixed gain, for every seed."""
    pairs = zip(e.gain(reading, ADAPTIVE), e.gain(reading, FIXED), strict=True)
    return [a.time / f.time for a, f in pairs]
