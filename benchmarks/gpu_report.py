"""The report of `scripts/gpu_check.py`: JSON, and a page of Markdown tables."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from benchmarks.gpu_cases import FE, IMAGES

__all__ = ["FE", "IMAGES", "trouble", "write_report"]

Part = dict[str, Any]
_SOLVED = 1e-5  # ten times the tolerance
_SEEN = {"mean_difference": 1e-4, "most_difference": 5e-3}  # a grey level of 8 bit is 4e-3
_MEASURED = 0.03  # px, with the noise of the pictures


def write_report(parts: list[Part], scale: str, folder: Path, stem: str) -> list[Path]:
    """``<stem>.json`` and ``<stem>.md`` in ``folder``; returns their paths."""
    data, page = folder / f"{stem}.json", folder / f"{stem}.md"
    data.write_text(json.dumps({"scale": scale, "parts": parts}, indent=1) + "\n", "utf-8")
    sections = (_machine, _trouble, _kernels, _solver, _images, _correlation, _pictures)
    lines = [line for section in sections for line in section(parts, scale)]
    page.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return [data, page]


def _rows(parts: list[Part], kind: str) -> Iterator[tuple[str, dict[str, Any]]]:
    for part in parts:
        name, _, rest = part["part"].partition(":")
        if name == kind:
            for row in part["results"]:
                if "failed" not in row:
                    yield rest, row


def _seconds(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.2f} s" if value >= 0.9995 else f"{1e3 * value:.3g} ms"


def _error(value: float | None) -> str:
    return "-" if value is None else f"{value:.1e}"


def _machine(parts: list[Part], scale: str) -> list[str]:
    (_, own), *_ = _rows(parts, "adapter")
    total = sum(part.get("seconds", 0.0) for part in parts)
    size = "the small cases" if scale == "quick" else "the large cases"
    info = own["info"]
    facts = {
        "adapter": own["name"],
        "kind": ", ".join(v for k in ("adapter_type", "backend_type") if (v := info.get(k))),
        "real numbers": "64-bit floats" if own["real"] == "f64" else "pairs of 32-bit floats",
        "timestamps": "yes" if own["timestamps"] else "no: device times aren't known",
        "host": f"{own['processor']}, {own['cores']} cores, {own['system']}",
        "versions": f"gpusim {own['gpusim']}, Python {own['python']}, NumPy {own['numpy']}",
        "run": f"{size}, {total:.0f} s in all",
    }
    table = [f"| {name} | {value} |" for name, value in facts.items()]
    return [f"# gpusim on {own['name']}", "", "| | |", "|---|---|", *table, ""]


def trouble(parts: list[Part]) -> list[str]:
    """What went wrong, one line each: parts that failed, kernels, results that are off."""
    lines = [f"{part['part']}: {part['failed']}" for part in parts if part["failed"]]
    for real, row in _rows(parts, "doctor"):
        if row["verdict"] == "wrong":
            lines.append(f"{real}, {row['stage']}: {row['message']}")
    for _, row in _rows(parts, "fe"):
        if not row["converged"] or not _within(row["error"], _SOLVED):
            lines.append(f"{row['case']}, {row['where']}: off by {_error(row['error'])}")
    for _, row in _rows(parts, "image"):
        for key in ("mean_difference", "most_difference") if "case" in row else ():
            if not _within(row[key], _SEEN[key]):
                lines.append(f"{row['case']}: {key.replace('_', ' ')} {_error(row[key])}")
    for _, row in _rows(parts, "dic"):
        if not _within(row["rms"], _MEASURED) or row["measured"] < 0.9 * row["subsets"]:
            lines.append(f"correlation, {row['where']}: {row['measured']} of {row['subsets']} "
                         f"measured, RMS error {_error(row['rms'])} px")  # fmt: skip
    return lines


def _within(value: float | None, limit: float) -> bool:
    return value is not None and value <= limit


def _trouble(parts: list[Part], scale: str) -> list[str]:
    lines = [f"- {text}" for text in trouble(parts)] or ["Nothing."]
    return ["## What went wrong", "", *lines, ""]


def _kernels(parts: list[Part], scale: str) -> list[str]:
    reals = list(dict.fromkeys(real for real, _ in _rows(parts, "doctor")))
    if not reals:
        return []
    found: dict[str, dict[str, str]] = {}
    for real, row in _rows(parts, "doctor"):
        said = {"began": "died or hung", "wrong": "**wrong**"}.get(row["verdict"])
        found.setdefault(row["stage"], {})[real] = said or f"ok, {_seconds(row['seconds'])}"
    words = {"f64": "with shader-f64", "double_single": "without"}
    head = " | ".join(words[real] for real in reals)
    lines = ["## Kernels against their NumPy twins", "", f"| stage | {head} |",
             "|---" * (1 + len(reals)) + "|"]  # fmt: skip
    for stage, verdicts in sorted(found.items()):
        cells = " | ".join(verdicts.get(real, "-") for real in reals)
        lines.append(f"| {stage} | {cells} |")
    return [*lines, ""]


def _solver(parts: list[Part], scale: str) -> list[str]:
    lines = [
        "## Solver", "",
        "Multigrid at tolerance 1e-6, forced onto the host and onto the device. The error is the "
        "largest difference to the host's solution at 1e-9, over the largest displacement.", "",
        "| case | unknowns | where | total | error | iterations | stages |",
        "|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    count = len(lines)
    for _, row in _rows(parts, "fe"):
        stages = ", ".join(f"{name} {_seconds(value)}" for name, value in row["timings"].items())
        if row.get("device"):
            stages += f"; on the device {_seconds(sum(row['device'].values()))}"
        note = "" if row["converged"] else " (not converged)"
        lines.append(
            f"| {row['case']} | {row['unknowns']:,} | {row['where']} | {_seconds(row['seconds'])} "
            f"| {_error(row['error'])}{note} | {row['iterations']} | {stages} |"
        )
    return [*lines, ""] if len(lines) > count else []


def _images(parts: list[Part], scale: str) -> list[str]:
    lines = [
        "## Images", "",
        "Host: until the image lies on the device. Differences to the stored image of a software "
        "adapter, over its white: largest of the means of 384 blocks, and of single pixels in "
        "squares around targets.", "",
        "| image | pixels | triangles | first | warm, host | device | read-back | block | pixel |",
        "|---|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    count = len(lines)
    for _, row in _rows(parts, "image"):
        if "case" not in row:
            continue
        lines.append(
            f"| {row['case']} | {row['width']} x {row['height']} | {row['triangles']:,} "
            f"| {_seconds(row['first'])} | {_seconds(row['warm'])} | {_seconds(row['device'])} "
            f"| {_seconds(row['read'])} | {_error(row['mean_difference'])} "
            f"| {_error(row['most_difference'])} |"
        )
    return [*lines, ""] if len(lines) > count else []


def _correlation(parts: list[Part], scale: str) -> list[str]:
    lines = [
        "## Image correlation", "",
        "| pictures | where | subsets | measured | first | warm | subsets per s | RMS error px |",
        "|---|---|---|---|---|---|---|---|",
    ]  # fmt: skip
    count = len(lines)
    for _, row in _rows(parts, "dic"):
        lines.append(
            f"| {row['case']} | {row['where']} | {row['subsets']:,} | {row['measured']:,} "
            f"| {_seconds(row['first'])} | {_seconds(row['warm'])} "
            f"| {row['subsets'] / row['warm']:,.0f} | {row['rms']:.5f} |"
        )
    return [*lines, ""] if len(lines) > count else []


def _pictures(parts: list[Part], scale: str) -> list[str]:
    paths = [Path(row["picture"]) for _, row in _rows(parts, "image") if "picture" in row]
    return ["## Pictures", "", *(f"![{path.stem}]({path.name})" for path in paths)] if paths else []
