"""Pictures of the tutorials: every figure that a block makes, without pyplot."""

from collections.abc import Iterator

from matplotlib.figure import Figure
from sphinx_gallery.scrapers import figure_rst

Variables = dict[str, object]


def scrape(_: object, block_vars: Variables, gallery_conf: Variables) -> str:
    """Save the figures that are new in a block's variables, and return what shows them."""
    paths: Iterator[str] = block_vars["image_path_iterator"]
    saved = []
    known: list[Figure] = gallery_conf.setdefault("figures_drawn", [])
    for value in list(block_vars["example_globals"].values()):
        if isinstance(value, Figure) and not any(value is k for k in known):
            known.append(value)
            saved.append(next(paths))
            value.savefig(saved[-1], dpi=110)
    return figure_rst(saved, gallery_conf["src_dir"])
