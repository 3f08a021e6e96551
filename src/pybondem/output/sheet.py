"""A sheet: pictures, tables and remarks of one subject, written as a page of Markdown with its tables as CSV."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pybondem.output.folder import provenance, write_json


@dataclass(frozen=True)
class Table:
    """A table: title, column heads, rows of text and numbers (already rounded as they should be read)."""

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Any]]


@dataclass
class Sheet:
    """What is to be shown of one subject.

    name: of its files; title: of its page; folder: where everything stands; pictures: files in the folder by caption;
    tables; remarks: paragraphs below them; facts: numbers for programs, written to NAME.json.
    """

    name: str
    title: str
    folder: Path
    pictures: dict[str, Path] = field(default_factory=dict)
    tables: list[Table] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)
    facts: dict[str, Any] = field(default_factory=dict)

    def write(self) -> Path:
        """Write the page, a CSV file for each table, and the facts with what made them; returns the page's path."""
        for number, table in enumerate(self.tables, 1):
            with (self.folder / f"{self.name}-table-{number}.csv").open("w", newline="", encoding="utf-8") as file:
                csv.writer(file).writerows([table.columns, *table.rows])
        write_json(self.folder / f"{self.name}.json", {**self.facts, "made with": provenance()})
        page = self.folder / f"{self.name}.md"
        page.write_text("\n\n".join([f"# {self.title}", *self._body()]) + "\n", encoding="utf-8")
        return page

    def _body(self) -> list[str]:
        """Return the paragraphs of the page."""
        pictures = [
            f"![{caption}]({path.relative_to(self.folder).as_posix()})\n\n*{caption}*"
            for caption, path in self.pictures.items()
        ]
        return [*pictures, *(_markdown(table) for table in self.tables), *self.remarks]

    def show(self) -> None:
        """Print the tables and remarks, and where the page is."""
        from rich.console import Console
        from rich.table import Column
        from rich.table import Table as Printed
        from rich.text import Text

        console = Console()
        for table in self.tables:
            heads = (Column(Text(head), overflow="fold") for head in table.columns)
            printed = Printed(*heads, title=Text(table.title), title_justify="left")
            for row in table.rows:
                printed.add_row(*(Text(str(cell)) for cell in row))
            console.print(printed)
        for remark in self.remarks:
            console.print(remark, markup=False, highlight=False)
        console.print(str(self.folder / f"{self.name}.md"), markup=False, highlight=False, soft_wrap=True)


def _markdown(table: Table) -> str:
    """Return a table as Markdown."""
    rows = [table.columns, ["---"] * len(table.columns), *table.rows]
    lines = ["| " + " | ".join(str(cell).replace("|", "\\|") for cell in row) + " |" for row in rows]
    return f"**{table.title}**\n\n" + "\n".join(lines)
