"""The pages of the site that are no Markdown files in docs/ (mkdocs.yml, make docs).

README, CONTRIBUTING, SECURITY and CHANGELOG are pages too, notebooks are run and shown with what they print and draw,
and files of the repository that a page links to are pages with their text, under source/. The first page has runs to
try, each written by ``verefine-viz share``; that of the causes begins with their pictures.
"""

from __future__ import annotations

import os
import posixpath
import re
import subprocess
import sys
import tempfile
import tomllib
from functools import cache
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page
from nbconvert import MarkdownExporter
from nbconvert.preprocessors import CoalesceStreamsPreprocessor, ExecutePreprocessor
from pygments.formatters import HtmlFormatter

# Else Open3D announces itself in the first cell.
os.environ.setdefault("OPEN3D_DISABLE_WEB_VISUALIZER", "true")
ROOT = Path(__file__).resolve().parents[1]
LINK = re.compile(r"(\]\()([^)\s#:]+)((?:#[^)\s]*)?\))")
"""A link to a file; addresses have a colon."""
CSS = """
pre code { white-space: pre-wrap !important; }
body::before { display: none; }
.navbar { background: #26323e !important; }
.live iframe { width: 100%; height: max(620px, 82vh); border: 1px solid #8886; }
.live a { margin-right: 1.5em; }
body:has(.live) .container { max-width: min(96vw, 1560px); }
body:has(.live) .col-md-3 { display: none; }
body:has(.live) .col-md-9 { flex: 0 0 100%; max-width: 100%; }
.causes { display: grid; grid-template-columns: repeat(auto-fill, minmax(180px, 1fr)); gap: 12px; margin: 1em 0 2em; }
.causes p { margin: 0; line-height: 1.25; }
.causes img { width: 100%; margin: 0; padding: 0; aspect-ratio: 4 / 3; object-fit: cover; display: block; }
"""
TOP = ("README.md", "CONTRIBUTING.md", "SECURITY.md", "CHANGELOG.md")
LIVE = {
    "mug": "A mug that comes right",
    "failure_score_prefers_wrong": "A jug that goes wrong, and why",
    "ycbv": "Real: YCB-Video, three estimators",
}
"""Sessions to try on the first page, and what they are; one whose data set is not at hand is left out."""
SECTION = re.compile(r"^## (.+?)\n.*?!\[([^\]]*)\]\((causes/[^)]+)\)", re.MULTILINE | re.DOTALL)
"""A cause: its title, and its picture with words."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages."""
    for name in TOP:
        files.append(File.generated(config, name, content=(ROOT / name).read_text(encoding="utf-8")))
    files.append(File.generated(config, "site.css", content=_css()))
    for name in _at_hand():
        files.append(File.generated(config, f"live/{name}.html", content=live_file(name)))
    for notebook in [file for file in files if file.src_uri.endswith(".ipynb")]:
        files.remove(notebook)
        _add_notebook(notebook.src_uri, files, config)
    for page in files.documentation_pages():
        for link in LINK.finditer(page.content_string):
            _add_source(_target(page.src_uri, link[2]), files, config)
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links to files of the repository into links to their pages."""

    def to_page(link: re.Match[str]) -> str:
        target = _target(page.file.src_uri, link[2])
        there = next((uri for uri in (target, f"source/{target}.md") if uri in files.src_uris), None)
        if there is None:
            return link[0]
        return f"{link[1]}{posixpath.relpath(there, posixpath.dirname(page.file.src_uri))}{link[3]}"

    if page.file.src_uri == "README.md":
        markdown = _before_first_section(markdown, _live())
    if page.file.src_uri == "causes.md":
        markdown = _before_first_section(markdown, _pictures(markdown, config))
    return LINK.sub(to_page, markdown)


@cache
def live_file(name: str) -> str:
    """Return the page of a session, run to its end, as one HTML file."""
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / f"{name}.html"
        words = ["share", ROOT / "sessions" / f"{name}.toml", "--out", out]
        subprocess.run([sys.executable, "-m", "verefine_viz", *words], check=True, cwd=ROOT)
        return out.read_text(encoding="utf-8")


def _at_hand() -> list[str]:
    """Sessions of built-in scenes, and those whose data set is there."""
    folder = ROOT / "sessions"
    scenes = {name: tomllib.loads((folder / f"{name}.toml").read_text(encoding="utf-8"))["scene"] for name in LIVE}
    return [name for name, scene in scenes.items() if "dataset" not in scene or (folder / scene["dataset"]).is_dir()]


def _live() -> str:
    """Links to runs, which open in a frame below them."""
    names = _at_hand()
    links = [f'<a href="live/{name}.html" target="live">{LIVE[name]}</a>' for name in names]
    frame = f'<iframe name="live" src="live/{names[0]}.html" title="A run to try"></iframe>'
    return f'<div class="live">\n<p><b>Try it here:</b> {" ".join(links)}</p>\n{frame}\n</div>'


def _pictures(causes: str, config: MkDocsConfig) -> str:
    """Every cause as a picture that leads to its section."""
    to_anchor = config.mdx_configs["toc"]["slugify"]
    cells = [
        f"[![{alt}]({src})]({'#' + to_anchor(title, '-')})<br>{title}" for title, alt, src in SECTION.findall(causes)
    ]
    return '<div class="causes" markdown="1">\n\n' + "\n\n".join(cells) + "\n\n</div>"


def _before_first_section(markdown: str, block: str) -> str:
    head, heading, rest = markdown.partition("\n## ")
    return f"{head}\n{block}\n{heading}{rest}"


def _target(page: str, link: str) -> str:
    """What a page links to: its address in docs/ or at the top, else its path in the repository."""
    folder = ROOT if page in TOP else (ROOT / "docs" / page).parent
    path = Path(os.path.normpath(folder / link))
    for home in (ROOT / "docs", ROOT):
        if path.is_relative_to(home):
            return re.sub(r"\.ipynb$", ".md", path.relative_to(home).as_posix())
    return link


def _add_notebook(uri: str, files: Files, config: MkDocsConfig) -> None:
    exporter = MarkdownExporter()
    exporter.register_preprocessor(ExecutePreprocessor(timeout=600), enabled=True)
    exporter.register_preprocessor(CoalesceStreamsPreprocessor(), enabled=True)
    text, _ = exporter.from_filename(str(ROOT / "docs" / uri))
    files.append(File.generated(config, uri.replace(".ipynb", ".md"), content=text))


def _css() -> str:
    """Colours of code, light and dark; long lines are wrapped."""
    dark = HtmlFormatter(style="github-dark").get_style_defs("[data-bs-theme=dark] .highlight")
    return f"{HtmlFormatter().get_style_defs('.highlight')}\n{dark}\n{CSS}"


def _add_source(target: str, files: Files, config: MkDocsConfig) -> None:
    path, uri = ROOT / target, f"source/{target}.md"
    if target in files.src_uris or uri in files.src_uris or not path.is_file():
        return
    kind = {".py": "python", ".comp": "glsl", ".glsl": "glsl"}.get(path.suffix, "text")
    text = path.read_text(encoding="utf-8")
    files.append(File.generated(config, uri, content=f"# {path.name}\n\n`{target}`\n\n````{kind}\n{text}\n````\n"))
