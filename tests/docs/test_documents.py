"""Documents: links lead somewhere, and every record of a decision has its parts and its place."""

from __future__ import annotations

import re
from pathlib import Path

PARTS = ("Context", "Decision", "Numbers", "Alternatives", "Measure again")


def documents(checkout: Path) -> list[Path]:
    folders = (checkout, checkout / "docs", checkout / "docs" / "decisions")
    return [path for folder in folders for path in sorted(folder.glob("*.md"))]


def heading_names(text: str) -> set[str]:
    """What links to headings end with, as on GitHub."""
    heads = re.findall(r"^#+ (.*)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head.lower()).replace(" ", "-") for head in heads}


def broken_links(path: Path) -> list[str]:
    broken = []
    for link in re.findall(r"\]\(([^)\s]+)\)", path.read_text(encoding="utf-8")):
        if link.startswith("http"):
            continue
        name, _, heading = link.partition("#")
        target = path.parent / name if name else path
        if not target.exists():
            broken.append(f"{path.name}: {link}")
        elif heading and heading not in heading_names(target.read_text(encoding="utf-8")):
            broken.append(f"{path.name}: {link}: no such heading")
    return broken


def test_links_lead_somewhere(checkout: Path) -> None:
    paths = documents(checkout)
    assert len(paths) > 60
    assert [link for path in paths for link in broken_links(path)] == []


def test_a_broken_link_is_seen(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text("# A head\n[here](#a-head) [there](none.md) [below](#none)", encoding="utf-8")
    assert len(broken_links(page)) == 2


def test_records_of_decisions_have_all_parts(checkout: Path) -> None:
    records = sorted((checkout / "docs" / "decisions").glob("[0-9]*.md"))
    assert [record.name[:3] for record in records] == [
        f"{n:03d}" for n in range(1, len(records) + 1)
    ]
    for record in records:
        text = record.read_text(encoding="utf-8")
        assert re.findall(r"^\*\*(.*?)\.\*\*", text, re.MULTILINE) == list(PARTS), record.name
        assert len(text.split()) <= 200, record.name
    index = (checkout / "docs" / "decisions" / "README.md").read_text(encoding="utf-8")
    assert re.findall(r"^- \[\d+\]\((.*?)\)", index, re.MULTILINE) == [r.name for r in records]
