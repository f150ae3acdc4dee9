"""One self-contained page: text, tables and pictures, light and dark, wide and narrow."""

import base64
import dataclasses
from collections.abc import Sequence
from html import escape
from pathlib import Path

_STYLE = """
:root { --paper: #fcfcfa; --ink: #1d2126; --muted: #656d76; --rule: #c9cdd1; --grid: #e8eaeb;
  --good: #00664a; --bad: #a63603; color-scheme: light dark; }
@media (prefers-color-scheme: dark) { :root { --paper: #14171a; --ink: #e6e8ea; --muted: #9aa3ac;
  --rule: #454c53; --grid: #272c31; --good: #5fd0a8; --bad: #ff9d66; } }
* { box-sizing: border-box; }
body { margin: 0 auto; max-width: 72rem; padding: 0 clamp(0.9rem, 3vw, 2.5rem) 3rem;
  background: var(--paper); color: var(--ink); font-variant-numeric: tabular-nums;
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, Arial, sans-serif; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 2.2rem 0 0.3rem; }
h2 { font-size: 1.15rem; margin: 2.6rem 0 0.4rem; }
p, li { max-width: 48rem; overflow-wrap: anywhere; }
p { margin: 0.5rem 0; } li + li { margin-top: 0.3rem; }
a { color: inherit; }
.scroll { overflow-x: auto; margin: 0.9rem 0; }
caption { text-align: left; color: var(--muted); font-size: 0.9rem; padding-bottom: 0.3rem; }
table { border-collapse: collapse; font-size: 0.9rem; }
th, td { padding: 0.32rem 1rem 0.32rem 0; text-align: right; vertical-align: top; }
td { border-bottom: 1px solid var(--grid); white-space: nowrap; }
th { vertical-align: bottom; border-bottom: 1px solid var(--ink); font-weight: 600; }
th:first-child, td:first-child { text-align: left; white-space: normal; min-width: 11.5rem; }
td small { color: var(--muted); display: block; font-size: 0.8rem; }
.good { color: var(--good); } .bad { color: var(--bad); font-weight: 600; }
figure { margin: 1.4rem 0; }
figcaption { color: var(--muted); font-size: 0.9rem; max-width: 48rem; }
img { width: 100%; height: auto; border-radius: 4px; background: white; }
footer { margin-top: 3rem; color: var(--muted); font-size: 0.9rem; }
@media print { figure, tr { break-inside: avoid; } }
"""


@dataclasses.dataclass(frozen=True)
class Cell:
    """One entry of a table.

    Parameters
    ----------
    text : str
        Escaped here.
    note : str
        Small, below.
    good : bool, optional
        Whether it is a success; None if it is neither.
    """

    text: str
    note: str = ""
    good: bool | None = None

    def html(self) -> str:
        """As an element of a row."""
        kind = {None: "", True: ' class="good"', False: ' class="bad"'}[self.good]
        note = f"<small>{escape(self.note)}</small>" if self.note else ""
        return f"<td{kind}>{escape(self.text)}{note}</td>"


def table(head: Sequence[str], rows: Sequence[Sequence[str | Cell]], *, caption: str = "") -> str:
    """Table with its own horizontal scrolling."""
    cells = [[c if isinstance(c, Cell) else Cell(c) for c in row] for row in rows]
    body = "".join(f"<tr>{''.join(c.html() for c in row)}</tr>\n" for row in cells)
    names = "".join(f"<th>{escape(h)}</th>" for h in head)
    title = f"<caption>{escape(caption)}</caption>" if caption else ""
    return (
        f'<div class="scroll"><table>{title}<thead><tr>{names}</tr></thead>\n'
        f"<tbody>\n{body}</tbody></table></div>\n"
    )


def picture(path: Path, caption: str) -> str:
    """PNG, embedded; the caption is also what is read out in its place."""
    data = base64.b64encode(path.read_bytes()).decode()
    image = f'<img src="data:image/png;base64,{data}" alt="{escape(caption)}">'
    return f"<figure>{image}<figcaption>{escape(caption)}</figcaption></figure>\n"


def text(*paragraphs: str) -> str:
    """Paragraphs, escaped."""
    return "".join(f"<p>{escape(p)}</p>\n" for p in paragraphs)


def items(*points: str) -> str:
    """Bulleted list, escaped."""
    return "<ul>\n" + "".join(f"<li>{escape(p)}</li>\n" for p in points) + "</ul>\n"


def page(title: str, sections: Sequence[tuple[str, str]], *, lead: str, foot: str) -> str:
    """Put a page together.

    Parameters
    ----------
    title : str
    sections : sequence of (heading, HTML)
    lead, foot : str
        HTML below the title and at the end.
    """
    body = "".join(
        f"<section><h2>{escape(h)}</h2>\n{content}</section>\n" for h, content in sections
    )
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style></head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n{lead}{body}<footer>{foot}</footer>\n</body></html>\n"
    )
