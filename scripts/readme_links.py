"""Metadata hook of hatchling: README as a package index shows it, where nothing lies beside it.

Its pictures and links lead to the repository (``project.urls`` of pyproject.toml), at the tag of the version; without
an address README stays as it is.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

LINK = re.compile(r"(!\[[^\]]*\]|\])\((?![a-z]+:|#)([^)\s]+)\)")
"""A picture, or a link to a file; addresses have a colon, and headings of README itself a hash."""


class ReadmeLinks(MetadataHookInterface):
    """Gives README to the metadata."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set ``readme``, from the version and the address of the repository that are known."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        if repository := metadata.get("urls", {}).get("Repository"):
            text = absolute(text, repository.rstrip("/"), f"v{metadata['version']}")
        metadata["readme"] = {"content-type": "text/markdown", "text": text}


def absolute(readme: str, repository: str, tag: str) -> str:
    """Return README with pictures and links that lead to the repository's files at a tag."""

    def to_repository(link: re.Match[str]) -> str:
        kind = "raw" if link[1].startswith("!") else "blob"
        return f"{link[1]}({repository}/{kind}/{tag}/{link[2]})"

    return LINK.sub(to_repository, readme)
