"""The command line, for what others bring."""

from cli.conftest import backsight as backsight
