"""Every tutorial and chapter as the notebook that a reader downloads, in a kernel of its own."""

import copy
import json
from pathlib import Path

import pytest

DOCS = Path(__file__).parents[2] / "docs"
PROGRAMS = sorted([*(DOCS / "tutorials").glob("t*.py"), *(DOCS / "theory").glob("*.py")])

pytestmark = pytest.mark.slow
nbclient = pytest.importorskip("nbclient", reason="nbclient is not installed")
pytest.importorskip("ipykernel", reason="ipykernel is not installed")


def notebook(program: Path, folder: Path):
    """The notebook that the site offers for a program."""
    import nbformat

    gallery = pytest.importorskip("sphinx_gallery.gen_gallery")
    from sphinx_gallery.notebook import jupyter_notebook
    from sphinx_gallery.py_source_parser import split_code_and_text_blocks

    _, blocks = split_code_and_text_blocks(str(program))
    made = jupyter_notebook(blocks, copy.deepcopy(gallery.DEFAULT_GALLERY_CONF), str(folder))
    return nbformat.reads(json.dumps(made), as_version=4)


@pytest.mark.parametrize("program", PROGRAMS, ids=lambda p: p.stem)
def test_a_notebook_runs_from_top_to_bottom(tmp_path, program):
    made = notebook(program, tmp_path)
    there = {"metadata": {"path": str(program.parent)}}
    nbclient.NotebookClient(made, timeout=600, kernel_name="python3", resources=there).execute()
    cells = [cell for cell in made.cells if cell.cell_type == "code"]
    assert cells
    outputs = [output for cell in cells for output in cell.outputs]
    assert outputs
    said = [o.text for o in outputs if o.output_type == "stream" and o.name == "stderr"]
    assert not [text for text in said if "Warning" in text], said
