"""An estimator over recordings, streams and windows."""

from backsight.doors import door as _door

__getattr__, __dir__, __all__ = _door(__name__, __path__[0])
