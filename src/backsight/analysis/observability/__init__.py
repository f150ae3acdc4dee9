"""What measurements can show of states, parameters and forces."""

from backsight.doors import door as _door

__getattr__, __dir__, __all__ = _door(__name__, __path__[0])
