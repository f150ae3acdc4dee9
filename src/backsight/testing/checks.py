"""The contract of an estimator: one entry of `CHECKS` for every promise."""

import dataclasses
from collections.abc import Callable
from typing import Literal

from backsight.testing import _estimates, _recursions
from backsight.testing.case import Subject


@dataclasses.dataclass(frozen=True)
class Check:
    """One promise of the contract.

    Parameters
    ----------
    run : callable
        Takes a `Subject`; raises `AssertionError` with what is broken. Its docstring says what is
        promised.
    needs : {"", "parameter", "two outputs", "held input"}
        What the problem must have for it.
    statistics : bool
        It is about the covariance as that of the error; bounds that are worst cases break it.
    both_engines : bool
        It depends on the engine.
    """

    run: Callable[[Subject], None]
    needs: Literal["", "parameter", "two outputs", "held input"] = ""
    statistics: bool = False
    both_engines: bool = True

    @property
    def name(self) -> str:
        """Of the function."""
        return self.run.__name__

    @property
    def promise(self) -> str:
        """The first line of the docstring."""
        return (self.run.__doc__ or "").partition("\n")[0]

    def applies(self, on: Subject) -> bool:
        """Whether the problem has what the check needs."""
        match self.needs:
            case "parameter":
                return not on.problem.k_known
            case "two outputs":
                return on.problem.ny > 1
            case "held input":
                return on.hold == "zoh"
        return True


CHECKS: tuple[Check, ...] = (
    Check(_recursions.pure),
    Check(_recursions.memory_sizes),
    Check(_recursions.engine_does_what_one_step_after_the_other_does),
    Check(_recursions.block_size_is_irrelevant),
    Check(_recursions.carry_is_all_the_memory),
    Check(_recursions.progress_ends_with_the_number_of_samples),
    Check(_recursions.stream_is_the_batch),
    Check(_recursions.pickles),
    Check(_recursions.long_runs_keep_the_covariance_positive, needs="held input"),
    Check(_estimates.result_has_the_schema, both_engines=False),
    Check(_estimates.perfect_model_gives_zero_error),
    Check(_estimates.constant_parameter_is_recovered, needs="parameter", statistics=True),
    Check(_estimates.nis_is_in_its_band, statistics=True),
    Check(_estimates.errors_are_as_large_as_the_covariance_says, statistics=True),
    Check(_estimates.value_under_the_mask_has_no_influence),
    Check(
        _estimates.channel_never_measured_is_a_channel_deleted,
        needs="two outputs",
        both_engines=False,
    ),
    # Of the formulas, whichever engine computes them.
    Check(_estimates.units_are_irrelevant, both_engines=False),
    Check(_estimates.scales_are_irrelevant, both_engines=False),
    Check(_estimates.start_without_measurements_is_prediction),
    Check(_estimates.clipping_is_reported, needs="parameter"),
    Check(_estimates.breakdown_names_the_sample, both_engines=False),
)
"""Every promise, simple ones first."""
