"""Formulas as MathML: browsers draw it themselves, without a script and without a network."""

import html
import re
from xml.etree import ElementTree

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml
from sphinx.application import Sphinx
from sphinx.util.math import get_node_equation_number
from sphinx.writers.html5 import HTML5Translator

# What the converter of docutils does not know, or reads otherwise than LaTeX does.
REWRITTEN = (
    (r"\\dots\b", r"\\ldots"),
    (r"\\(t?frac)\s*(\d)\s*(\d)", r"\\\1{\2}{\3}"),
    (r"\\tag\{([^}]*)\}", r"\\qquad (\1)"),
)

MATHML = "http://www.w3.org/1998/Math/MathML"
ACCENTS = frozenset("~ˉˆ˙¨ˇ→⃗˜¯^")  # of tildes, bars, hats, dots, arrows
ElementTree.register_namespace("", MATHML)


def formula(tex: str, *, block: bool) -> str:
    """MathML of a formula in LaTeX."""
    tex = r" \\ ".join(part for part in tex.split("\n\n") if part.strip())  # as Sphinx does
    if "&" in tex and r"\begin" not in tex:
        tex = rf"\begin{{aligned}} {tex} \end{{aligned}}"
    for pattern, replacement in REWRITTEN:
        tex = re.sub(pattern, replacement, tex)
    return _indexed(tex2mathml(tex, as_block=block))


def _indexed(mathml: str) -> str:
    """Put indices of accented letters, which the converter sets under them, at their foot."""
    # Names of characters that HTML knows and XML does not.
    tree = ElementTree.fromstring(re.sub(r"&(?!(?:amp|lt|gt|quot|apos);)\w+;", _character, mathml))
    for under in tree.iter(f"{{{MATHML}}}munderover"):
        letter, index, over = under
        if over.text not in ACCENTS:
            continue
        accented = ElementTree.Element(f"{{{MATHML}}}mover", {"accent": "true"})
        accented.extend([letter, over])
        for child in (letter, index, over):
            under.remove(child)
        under.tag = f"{{{MATHML}}}msub"
        under.extend([accented, index])
    return ElementTree.tostring(tree, encoding="unicode")


def _character(name: re.Match[str]) -> str:
    return html.unescape(name[0])


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
