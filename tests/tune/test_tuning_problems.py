"""The figures of the page on tuning, on a few of its recordings."""

import pytest
from benchmarks.tuning import trial
from benchmarks.tuning_problems import MACHINES


@pytest.mark.slow
@pytest.mark.parametrize("machine", MACHINES, ids=lambda m: m.name)
def test_noise_is_found_from_settings_that_are_wrong_by_large_factors(machine):
    for seed in (20, 21):  # R too large, then too small, neither among those of the table
        found = trial(machine, seed)
        assert found.likelihood < 0.001
        assert max(found.errors_y, default=0) < 0.08
        assert max(found.errors_w, default=0) < 0.25
        assert max(map(abs, found.deviations)) < 4
        assert found.nis
        assert found.cover > 0.985
        assert found.passes <= 100
