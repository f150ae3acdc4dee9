"""How a recursion is described and executed."""

import os

import casadi as ca

from backsight.kernels import sources

# CasADi looks here for the library of the kernels, also when a recursion is unpickled.
ca.GlobalOptions.setCasadiPath(
    os.pathsep.join([ca.GlobalOptions.getCasadiPath(), str(sources.FOLDER)])
)
