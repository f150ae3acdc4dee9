"""Process noise and covariances with a structure as sums of parts that numbers multiply."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from backsight.estimators.uncertainty import Noise
from backsight.estimators.varied_noise import NoisePart, VariedNoise
from backsight.models.model import Model
from backsight.tune.fitting.values import (
    Unknown,
    matrices_of,
    walk_factor,
    walk_parts,
)


@dataclasses.dataclass(frozen=True)
class FreeNoise:
    """The numbers that stand for those unknowns that are noise: factors, and entries of roots.

    Parameters
    ----------
    unknowns : tuple of Unknown
        Also those that are no noise.
    """

    unknowns: tuple[Unknown, ...]

    @property
    def _walks(self) -> list[Unknown]:
        return [u for u in self.unknowns if u.kind == "walk"]

    @property
    def names(self) -> list[str]:
        """Name of every number."""
        roots = [(m.word, i, j) for m in matrices_of(self.unknowns) for i, j in m.entries]
        return [*map(_factor, self._walks), *(_root(word, i, j) for word, i, j in roots)]

    def numbers(self, values: Mapping[str, float]) -> list[float]:
        """The numbers, from the values of the unknowns by name."""
        roots = [(m, m.root(values)) for m in matrices_of(self.unknowns)]
        return [
            *(walk_factor(u, values[u.name]) for u in self._walks),
            *(float(root[i, j]) for m, root in roots for i, j in m.entries),
        ]

    def varied(self, noise: Noise, model: Model) -> VariedNoise:
        """Noise that they multiply, by their names."""
        parts = []
        rest = {"Q": noise.stated_process(model), "Qc": noise.stated_density(model)}
        for u in self._walks:
            word, part = walk_parts(noise, model, u)
            rest[word] = rest[word] - part
            parts.append(NoisePart((_factor(u),) * 2, **{word: part}))
        for matrix in matrices_of(self.unknowns):
            rest[matrix.word] = np.zeros((len(matrix.names),) * 2)
            for a, b, E in matrix.products():
                factors = _root(matrix.word, *a), _root(matrix.word, *b)
                parts.append(NoisePart(factors, **{matrix.word: E}))
        fields: dict[str, Any] = {f.name: getattr(noise, f.name) for f in dataclasses.fields(noise)}
        fields |= {"sigma_w": None, "Q": None, "Qc": None}
        fields |= {word: left for word, left in rest.items() if word != "R" and left.any()}
        return VariedNoise(**fields, parts=tuple(parts))


def _factor(unknown: Unknown) -> str:
    return "factor_of_" + unknown.entry.replace(".", "_")


def _root(word: str, i: int, j: int) -> str:
    return f"root_of_{word}_{i}_{j}"
