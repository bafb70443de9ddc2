"""The page's server, asked over real connections: who is served, who is refused, and who waits for whom."""

import http.client
import json
import re
import socket
import time

import numpy as np
import pytest

from tactsim.bench.watching import PadReader
from tactsim.bench.watching.web import HOST, WebPage

RAMP = np.arange(36.0)


@pytest.fixture
def served(source, device):
    with (
        PadReader(source, device, "</script><b>here-\udcff.tactrec") as reader,  # as Python spells no UTF-8
        WebPage(reader, 0, from_behind=True) as page,
    ):
        yield reader, int(page.url.rsplit(":", 1)[1].strip("/"))


def ask(port, method, path, **headers):
    connection = http.client.HTTPConnection(HOST, port, timeout=10)
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    content = answer.read() if path != "/events" else b""
    connection.close()
    return answer.status, content.decode()


def events(port):
    """Open the stream; gives a function that returns the next event, and the connection."""
    connection = socket.create_connection((HOST, port), timeout=10)
    connection.sendall(f"GET /events HTTP/1.1\r\nHost: {HOST}:{port}\r\n\r\n".encode())
    lines = connection.makefile("rb")

    def following():
        while True:
            line = lines.readline()
            assert line
            if line.startswith(b"data: "):
                return json.loads(line[6:])

    return following, connection


def test_the_page_is_whole_and_names_cannot_become_markup(served):
    _, port = served
    status, text = ask(port, "GET", "/")
    assert status == 200
    assert not re.search(r"""(?:src|href)=["'](?!data:)""", text)
    assert text.count("<script") == 2
    assert "<b>here" not in text
    assert r"&lt;b&gt;here-\udcff.tactrec</title>" in text
    assert "default-src 'none'" in text
    assert ask(port, "GET", "/x")[0] == 404


def test_events_show_the_latest_reading_and_the_whole_history(served, source, silence):
    _, port = served
    following, connection = events(port)
    with connection:
        source.feed(RAMP)
        while not (event := following())["pressures"]:
            assert not any(event["history"])
        assert event["pressures"] == RAMP.tolist()
        assert event["state"] == "live"
        silence(0.3)
        while event["state"] == "live":
            event = following()
        assert any(event["history"])
        assert event["pressures"] is None


def test_a_browser_that_takes_nothing_delays_neither_the_reading_nor_the_others(served, source, fed):
    _, port = served
    stalled = socket.create_connection((HOST, port))
    stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
    stalled.sendall(f"GET /events HTTP/1.1\r\nHost: {HOST}:{port}\r\n\r\n".encode())
    following, connection = events(port)
    with fed(source, [RAMP] * 1000), connection, stalled:
        begun, late = time.monotonic(), []
        while time.monotonic() < begun + 2.0:
            event = following()
            late.append(source.given - event["readings"])
    assert event["readings"] > 100
    assert np.median(late) <= 2


def test_only_this_page_is_obeyed(served, source, eventually):
    reader, port = served
    for headers in ({}, {"Host": "evil.example", "X-Tactsim": "1"}):
        assert ask(port, "POST", "/do/tare", **headers)[0] == 403
    assert ask(port, "GET", "/", Host="evil.example")[0] == 421
    assert ask(port, "GET", "/events", Host=f"evil.example:{port}")[0] == 421
    assert reader.view().message == ""
    assert ask(port, "POST", "/do/tare", **{"X-Tactsim": "1"})[0] == 200
    assert reader.view().message.startswith("taking a tare")
    assert ask(port, "POST", "/do/harm", **{"X-Tactsim": "1"})[0] == 404
