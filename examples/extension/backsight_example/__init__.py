"""An extension of Backsight."""
