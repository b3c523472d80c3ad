"""Whom the page's server answers: by the Host and the Origin of a request."""

from __future__ import annotations

import socket

import pytest

from verefine_viz.core.errors import SettingsError
from verefine_viz.viewer.web.admission import Admission, read_origin

PORT = 8080
NAME = socket.gethostname().lower()


def test_host_and_origin_must_be_ours() -> None:
    for bound, host, origin, is_admitted in (
        ("127.0.0.1", "127.0.0.1:8080", None, True),
        ("127.0.0.1", "LocalHost:8080", "http://localhost:8080", True),
        ("127.0.0.1", "[::1]:8080", "http://localhost:8080", True),
        ("127.0.0.1", "127.0.0.1", None, False),
        ("127.0.0.1", "127.0.0.1:8081", None, False),
        ("127.0.0.1", "192.168.1.5:8080", None, False),
        ("127.0.0.1", f"{NAME}:8080", None, False),
        ("127.0.0.1", "evil.example:8080", "http://evil.example:8080", False),
        ("127.0.0.1", "127.0.0.1:8080", "http://127.0.0.1:8081", False),
        ("127.0.0.1", "127.0.0.1:8080", "https://127.0.0.1:8080", False),
        ("127.0.0.1", "127.0.0.1:8080", "null", False),
        ("192.168.1.5", "192.168.1.5:8080", "http://192.168.1.5:8080", True),
        ("192.168.1.5", f"{NAME}:8080", f"http://{NAME}:8080", True),
        ("192.168.1.5", "192.168.1.6:8080", None, False),
        ("0.0.0.0", "192.168.1.5:8080", "http://192.168.1.5:8080", True),
        ("0.0.0.0", "192.168.1.5:8080", "http://6.6.6.6:8080", False),
        ("0.0.0.0", "192.168.1.5:8081", "http://192.168.1.5:8081", False),
        ("0.0.0.0", "192.168.1.5:x", None, False),
        ("0.0.0.0", "evil.example:8080", "http://evil.example:8080", False),
        ("::", "[fe80::1]:8080", "http://[fe80::1]:8080", True),
        ("::", "fe80::1", None, False),
    ):
        found = Admission(bound).admits(PORT, [host], [origin] if origin else [])
        assert found is is_admitted, (bound, host, origin)


def test_a_request_with_no_host_or_with_two_headers_of_a_kind_is_refused() -> None:
    ours, evil = "127.0.0.1:8080", "evil.example"
    for hosts, origins in (([], []), ([ours, evil], []), ([ours], [f"http://{ours}", f"http://{evil}"])):
        assert not Admission("127.0.0.1").admits(PORT, hosts, origins), (hosts, origins)


def test_the_usual_port_is_left_out_as_browsers_do() -> None:
    assert Admission("127.0.0.1").admits(80, ["localhost"], ["http://localhost"])


def test_an_origin_is_read_as_browsers_write_it() -> None:
    assert read_origin("http://localhost:3000") == "http://localhost:3000"
    assert read_origin("HTTPS://Viz.Example:443/") == "https://viz.example"
    assert read_origin("http://[::1]:9000") == "http://[::1]:9000"


def test_what_is_no_origin_is_one_clear_line() -> None:
    for text in (
        "", "*", "null", "localhost:3000", "http://", "http://a/b", "http://a b", "ws://a", "http://u@a", "http://a:0",
        "http://a:65536", "http://a:٣", "http://a\n", "http://*.a",
    ):  # fmt: skip
        with pytest.raises(SettingsError, match=r"^--allow-origin .* is no origin; expected scheme") as error:
            Admission("127.0.0.1", [text])
        assert "\n" not in str(error.value), repr(text)
