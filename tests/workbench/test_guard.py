"""Only the page that knows the token, under the name of this computer, is answered."""

import json
import re
import socket
from urllib.parse import urlsplit

import pytest

from backsight.errors import OutputError
from backsight.workbench.serving import ready_to_serve


def test_it_listens_on_this_computer_only_and_every_address_has_a_token(served):
    place = urlsplit(served.address)
    assert place.hostname == "127.0.0.1"
    assert re.fullmatch(r"/[\w-]{32}/", place.path)


@pytest.mark.parametrize("path", ["/", "/state", "/x/state", "/%2e%2e/state", "//state", "/report"])
def test_without_the_token_nothing_is_told(served, path):
    status, _, body = served.raw("GET", path)
    assert status == 403
    assert b"backsight open" in body


def test_another_name_or_another_page_is_refused(served):
    path = f"{urlsplit(served.address).path}state"
    assert served.raw("GET", path)[0] == 200
    assert served.raw("GET", path, Host="evil.example")[0] == 403
    assert served.raw("GET", path, Host="127.0.0.1:1")[0] == 403
    assert served.raw("GET", path, Origin="http://evil.example")[0] == 403
    check = path.replace("state", "check")
    assert served.raw("POST", check, b'{"text": ""}', Origin="null")[0] == 403
    assert served.raw("POST", check, b'{"text": ""}')[0] == 200


def test_answers_allow_no_other_origin_and_no_foreign_script(served):
    _, headers, _ = served.raw("GET", urlsplit(served.address).path)
    assert "access-control-allow-origin" not in headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cache-control"] == "no-store"


@pytest.mark.parametrize("name", ["page.html/../../gallery.py", "..%2fgallery.py", "absent.js"])
def test_only_the_files_of_the_page_are_given_away(served, name):
    status, _, _ = served.raw("GET", f"{urlsplit(served.address).path}page/{name}")
    assert status == 404


@pytest.mark.parametrize("name", ["", "..", "/", "a\0b", "x" * 300])
def test_names_that_are_none_for_files_are_refused(served, name):
    from urllib.parse import quote

    path = f"{urlsplit(served.address).path}recording?name={quote(name)}"
    status, _, body = served.raw("PUT", path, b"t,y\n0,1\n")
    assert status == 422
    assert "name of the file" in json.loads(body)["error"]


def test_a_path_in_a_name_leads_nowhere(served):
    before = sorted(served.bench.folder.parent.rglob("*"))
    path = f"{urlsplit(served.address).path}recording?name=../../outside.csv"
    assert served.raw("PUT", path, b"nothing")[0] == 422  # no table: it is taken away again
    assert sorted(served.bench.folder.parent.rglob("*")) == before


def test_large_requests_are_refused(served):
    path = f"{urlsplit(served.address).path}check"
    status, _, body = served.raw("POST", path, b" " * 1_100_000)
    assert status == 422
    assert "limit" in json.loads(body)["error"]
    for broken in (b"", b"[]", b"{", b"[" * 50_000):
        assert served.raw("POST", path, broken)[0] == 422


def test_a_port_that_is_taken_is_said(served):
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        port = other.getsockname()[1]
        with pytest.raises(OutputError, match=f"port {port}"), ready_to_serve(served.bench, port):
            pass
