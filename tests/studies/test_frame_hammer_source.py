"""Recordings of the study `frame_hammer`: read as they are, or refused."""

import numpy as np
import pytest

from backsight.errors import DataError
from backsight_studies import STUDIES
from backsight_studies.frame_hammer import source
from backsight_studies.frame_hammer.source import read

NOISE = np.random.default_rng(0).standard_normal((2000, 4))


class TestSource:
    def test_missing_recordings_are_named_with_their_source(self, monkeypatch, tmp_path):
        monkeypatch.delenv(source.VARIABLE, raising=False)
        with pytest.raises(DataError, match=r"x160_multi\.npz .* --recording; they come from git"):
            STUDIES["frame_hammer"].run(tmp_path)
        assert list(tmp_path.iterdir()) == []

    @pytest.mark.parametrize(
        ("content", "message"),
        [
            (None, "cannot be read as a NumPy file"),
            ({"acc_ms2": np.zeros((2000, 4))}, "the accelerometer at 0.34 m never changes"),
            ({"y": np.zeros(3)}, "no accelerations 'acc_ms2'"),
            ({"acc_ms2": np.zeros((2000, 3))}, r"4 accelerometers; its shape is \(2000, 3\)"),
            (
                {"acc_ms2": NOISE, "t_acc_s": 2e-3 * np.arange(2000)},
                "its sampling period is 0.002 s",
            ),
            (
                {"acc_ms2": NOISE, "hit_time_s": np.ones(2)},
                "no hit_height_m, hit_impulse_Ns",
            ),
        ],
    )
    def test_files_of_another_kind_are_refused(self, tmp_path, content, message):
        path = tmp_path / "hits.npz"
        if content is None:
            path.write_text("a,b\n1,2\n")
        else:
            np.savez(path, **content)
        with pytest.raises(DataError, match=message):
            read(path)

    def test_one_height_does_for_all_hits_and_the_clock_is_kept(self, tmp_path):
        path = tmp_path / "hits.npz"
        time = 3.0 + 1.1e-3 * np.arange(2000)
        np.savez(
            path, acc_ms2=NOISE, t_acc_s=time, hit_time_s=[3.5, 4.0],
            hit_height_m=0.81, hit_impulse_Ns=[0.1, 0.2],
        )  # fmt: skip
        found = read(path)
        assert found.name == "hits"
        np.testing.assert_array_equal(found.hammer.height, [0.81, 0.81])
        np.testing.assert_allclose(found.times([0, 1999]), time[[0, -1]])
