"""The version of the installed package; pyproject.toml is its only source."""

from __future__ import annotations

from importlib import metadata


def version() -> str:
    """Return it, such as "0.1.0"."""
    try:
        return metadata.version("ocptip")
    except metadata.PackageNotFoundError:
        return "0+not.installed"


__version__ = version()
