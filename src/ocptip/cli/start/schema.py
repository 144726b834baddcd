"""`ocptip schema`: prints the keys of all files, for editors or for people."""

from __future__ import annotations

import json
from argparse import Namespace
from dataclasses import dataclass
from typing import Any

from ocptip.cli.command import Report
from ocptip.task_files.reference import json_schema, reference_page


@dataclass
class SchemaReport(Report):
    """The keys of all files.

    Attributes:
        page: as a page, not as a JSON Schema.
    """

    page: bool

    def to_dict(self) -> dict[str, Any]:
        """The JSON Schema."""
        return json_schema()

    def to_json(self) -> str:
        """The JSON Schema as text."""
        return json.dumps(self.to_dict(), indent=1)

    def to_text(self) -> str:
        """The JSON Schema, or the page."""
        return reference_page().rstrip() if self.page else self.to_json()


def run(options: Namespace) -> SchemaReport:
    """Print the keys; nothing is read."""
    return SchemaReport(options.page)
