"""What comes over the wire: payloads of every form, in chunks of any size."""

import json
import random
import struct

from tests.fuzz.isolated import Area
from tests.fuzz.mutating import mutated_bytes, mutated_text

from backsight.live.sources._cutting import Cutter
from backsight.live.sources._decoding import payload_decoder
from backsight.problem.reading.tables import UdpFeed

FORMS = ("json", "text", "packed", "cbor")

ROW = {"t": 0.5, "u": -1.5, "y": None}
MANY = {"t": [0.5, 0.6], "u": [1.0, 2.0], "y": [0.0, 1e3], "units": {"y": "m"}}


def feed_of(form: str) -> UdpFeed:
    """The table of a source whose payloads have a form."""
    return UdpFeed.model_validate(
        {
            "kind": "udp",
            "port": 0,
            "time": "t",
            "format": form,
            "columns": ["t", "u", "y"] if form in ("text", "packed") else [],
            "struct": "<dff" if form == "packed" else "",
            "inputs": {"u": "u"},
            "outputs": {"y": {"column": "y", "unit": "m"}},
        }
    )


def right(form: str, draw: random.Random) -> bytes:
    """A payload as it should be."""
    content = draw.choice([ROW, MANY, [ROW, MANY]])
    if form == "json":
        return json.dumps(content).encode()
    if form == "cbor":
        import cbor2

        return cbor2.dumps(content)
    if form == "text":
        return b"0.5, -1.5,\n0.6,1e3,2\n"
    return struct.pack("<dff", 0.5, -1.5, 2.0) * draw.choice([1, 3])


def area() -> Area:
    """Payloads; the first byte says which form."""
    decoders = {form: payload_decoder(feed_of(form), "source.rig") for form in FORMS}

    def make(draw: random.Random) -> bytes:
        k = draw.randrange(len(FORMS))
        content = right(FORMS[k], draw)
        if FORMS[k] in ("json", "text") and draw.random() < 0.5:
            content = mutated_text(content.decode(), draw).encode("utf-8", "surrogatepass")
        else:
            content = mutated_bytes(content, draw)
        return bytes([k]) + content

    def attempt(case: bytes) -> None:
        form, content = FORMS[case[0]], case[1:]
        pieces = [content, b"", content[::2]]
        if form != "cbor":
            cutter = Cutter(feed_of(form), "source.rig")
            pieces += [p for k in range(0, len(content), 7) for p in cutter.cut(content[k : k + 7])]
            pieces.append(cutter.forget())
        for given in ([content], pieces):
            values, owner, faults = decoders[form](given)
            assert len(values) == len(owner)
            assert len(faults) <= len(given)

    return Area("payloads", make, attempt)
