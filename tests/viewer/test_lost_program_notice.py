"""What the page says while its program is gone. That it appears, and goes, takes a browser: tests/browser."""

from __future__ import annotations

from verefine_viz.viewer.web.viser_internals import lost_style, lost_words


def test_it_says_how_to_get_a_program_that_this_page_finds() -> None:
    assert "view …; this page" in lost_words(8080), "where the program listens by itself"
    assert "view … --port 8123; this page" in lost_words(8123)


def test_the_words_are_one_css_string() -> None:
    assert not set(lost_words(8123)) & set('"\\\n')
    assert f'content:"{lost_words(8123)}"' in lost_style(8123)
