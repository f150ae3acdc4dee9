"""``python -m backsight`` is the command line."""

from backsight.cli import app

app(prog_name="backsight")
