"""The version of the installed package; pyproject.toml is its only source."""

from __future__ import annotations


def version() -> str:
    """Return it, such as "0.1.0"."""
    from importlib import metadata  # loads for 20 ms

    try:
        return metadata.version("ocptip")
    except metadata.PackageNotFoundError:
        return "0+not.installed"
