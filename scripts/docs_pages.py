"""The pages of the site that are no Markdown files in docs/ (mkdocs.yml, make docs).

README, CONTRIBUTING and CHANGELOG are pages too, notebooks are run and shown with what they print and draw, and files
of the repository that a page links to are pages with their text, under source/.
"""

from __future__ import annotations

import os
import posixpath
import re
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
"""
TOP = ("README.md", "CONTRIBUTING.md", "CHANGELOG.md")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages."""
    for name in TOP:
        files.append(File.generated(config, name, content=(ROOT / name).read_text(encoding="utf-8")))
    files.append(File.generated(config, "site.css", content=_css()))
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

    return LINK.sub(to_page, markdown)


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
