"""Formulas as MathML: browsers draw it themselves, without a script and without a network."""

import re

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util.math import get_node_equation_number
from sphinx.writers.html5 import HTML5Translator

# What the converter of docutils does not know, or reads otherwise than LaTeX does.
REWRITTEN = (
    (r"\\dots\b", r"\\ldots"),
    (r"\\(t?frac)\s*(\d)\s*(\d)", r"\\\1{\2}{\3}"),
    # An index after an accent would be set under the letter.
    (r"(\\(?:hat|bar|dot|ddot|tilde|vec)\s*(?:\{[^{}]*\}|\\[A-Za-z]+|[A-Za-z]))", r"{\1}"),
    (r"\\tag\{([^}]*)\}", r"\\qquad (\1)"),
)


def formula(tex: str, *, block: bool) -> str:
    """MathML of a formula in LaTeX."""
    tex = r" \\ ".join(part for part in tex.split("\n\n") if part.strip())  # as Sphinx does
    if "&" in tex and r"\begin" not in tex:
        tex = rf"\begin{{aligned}} {tex} \end{{aligned}}"
    for pattern, replacement in REWRITTEN:
        tex = re.sub(pattern, replacement, tex)
    return tex2mathml(tex, as_block=block)


def inline(self: HTML5Translator, node: nodes.math) -> None:
    """Write a formula within a sentence."""
    self.body.append(formula(node.astext(), block=False))
    raise nodes.SkipNode


def displayed(self: HTML5Translator, node: nodes.math_block) -> None:
    """Write a formula on lines of its own, with its number."""
    number = f"<span>({get_node_equation_number(self, node)})</span>" if node["number"] else ""
    # Long formulas scroll by themselves, and a keyboard must reach what scrolls.
    start = self.starttag(node, "div", CLASS="math", tabindex="0", role="math")
    self.body.append(f"{start}{number}{formula(node.astext(), block=True)}</div>")
    raise nodes.SkipNode


def setup(app: Sphinx) -> dict[str, bool]:
    """Register this way of drawing formulas."""
    app.add_html_math_renderer("mathml", (inline, None), (displayed, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
