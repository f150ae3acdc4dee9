"""Completion in shells, each by the shell itself, as far as they are installed."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

FOLDER = Path(sys.executable).parent

ASKED = {
    "bash": """
eval "$(_BACKSIGHT_COMPLETE=source_bash backsight)"
COMP_WORDS=(backsight {words}); COMP_CWORD={last}
_backsight_completion backsight; printf '%s\\n' "${{COMPREPLY[@]}}"
""",
    "zsh": """
compdef() {{ :; }}
_arguments() {{ printf '%s\\n' "$@"; }}
_files() {{ echo FILES; }}
eval "$(_BACKSIGHT_COMPLETE=source_zsh backsight)"
words=(backsight {words}); CURRENT={last}+1
_backsight_completion
""",
    "fish": """
env _BACKSIGHT_COMPLETE=source_fish backsight | source
complete -C "backsight {words}"
""",
}
"""By shell: what says how `backsight` is completed, and then completes some words."""


@pytest.mark.parametrize(
    ("words", "found"),
    [("me", "methods"), ("run --f", "--force"), ("study r", "run")],
)
@pytest.mark.parametrize(
    "shell", ["bash", *(pytest.param(s, marks=pytest.mark.slow) for s in ("zsh", "fish"))]
)
def test_a_shell_completes_commands_and_options(tmp_path, shell, words, found):
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    script = ASKED[shell].format(words=words, last=len(words.split()))
    said = subprocess.run(
        [shell, *(["-f"] if shell == "zsh" else []), "-c", script],
        env=dict(os.environ, PATH=f"{FOLDER}:{os.environ['PATH']}", HOME=str(tmp_path)),
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert found in said.stdout
    assert "columns" not in said.stdout
    assert not said.stderr
