"""What is packed in a page."""

import base64
import gzip
import json
import re


def unpacked(page: str, part: str) -> str:
    """Text of a packed part of the page; its letters cannot end a script element early."""
    data = re.search(rf'id="{part}">(.*?)</script>', page, re.DOTALL)[1]
    assert re.fullmatch("[A-Za-z0-9+/=]+", data)
    return gzip.decompress(base64.b64decode(data)).decode("utf-8")


def figures_of(page: str) -> list[dict]:
    """All figures of the page, as plotly.js gets them."""
    return json.loads(unpacked(page, "figures"))["figures"]
