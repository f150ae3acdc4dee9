"""Matrices, mode shapes and tables of places from the files of finite-element programs."""

from backsight.data.matrices.matrix import EPS as EPS
from backsight.data.matrices.matrix import Matrix as Matrix
