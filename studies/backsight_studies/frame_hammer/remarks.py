"""What works and what does not, in sentences with numbers."""

from backsight_studies.frame_hammer.experiment import Case, Experiment
from backsight_studies.frame_hammer.score import EDGE, ISOLATED, Score


def remarks(experiment: Experiment) -> list[str]:
    """Sentences about the measured recordings."""
    return [
        *(_clipping(case) for case in experiment.measured),
        *(
            _sparse(case.recording.name, case.sparse_score, case.direct_score)
            for case in experiment.measured
            if case.sparse_score is not None and case.direct_score is not None
        ),
        "The channels are read one after the other, 0.14 ms apart: at 367 Hz that is 18 degrees of "
        "phase from one to the next.",
        "Eight bending modes are needed, up to 1005 and 1332 Hz, though the samples only reach to "
        "455 Hz: the limit comes before the low-pass and before the sampling, so what is beyond "
        "decides which part of the rest is seen.",
        f"A hit counts as isolated if no other one is within {ISOLATED:g} s, and the recording "
        f"goes on for {EDGE:g} s before and after it. Closer hits may be missed: a window looks "
        "for one hit.",
        "The impulse comes in N s, but take it as a relative size: it depends on the length of the "
        "pulse, which is one for all hits of a recording. Heights other than the three are not "
        "looked for.",
        "Touches of the hammer after a hit, of a few percent of its size, are below what the model "
        "can explain and are left out.",
        "What describes the rig was identified from free vibrations in the same two recordings; "
        "frequencies, limit and cutoff are calibrated again on every recording, without the signal "
        "of the hammer.",
        "The hits of the measured recordings are all at 1.60 m. That the other heights are found "
        "is shown on simulations whose rig differs from the model: frequencies by 0.3 %, gains, "
        "limit and cutoff by 3 to 4 %, places by 4 to 8 mm, and the shape of the pulses.",
    ]


def _clipping(case: Case) -> str:
    return (
        f"{case.recording.name}: between the hits, sensors with a limit of "
        f"{case.detection.track.axis.limit:.0f} m/s² before their low-pass leave "
        f"{case.limited:.1%} of the energy unexplained, the same model without limit "
        f"{case.unlimited:.1%}: the sensors are at their limit for much of the time while the beam "
        "rings."
    )


def _sparse(name: str, straight: Score, direct: Score) -> str:
    return (
        f"{name}: the compressive-sensing MHE finds {direct.right} of {direct.isolated} isolated "
        f"hits at the right height in the readings themselves, with {direct.false} false alarms "
        f"among {direct.reported}: it is linear, and the sensors are not. Once the clipping is "
        f"undone it finds {straight.right} of {straight.isolated}, with {straight.false} false "
        f"alarms among {straight.reported}. That confirms what the windows found, but is not "
        "independent of it: at the limit of a sensor the signals come from the windows. "
        "Its settings were chosen on the two recordings of the data set."
    )


def in_short(name: str, score: Score) -> str:
    """Score of a recording in a sentence."""
    return (
        f"{name}: {score.right} of {score.isolated} isolated hits at the right height, largest "
        f"error of time {1e3 * score.latest:.1f} ms, {score.false} false alarms, sizes within "
        f"{score.scatter:.0%} (standard deviation)."
    )
