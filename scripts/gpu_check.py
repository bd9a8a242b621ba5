"""One run that tells whether gpusim works on this machine's GPU, how exactly and how fast.

``scripts/gpu_check.sh`` calls this with the right interpreter. Every part runs in a process of its
own with a time limit: what fails, dies or hangs is a line of the report, and the others go on.
"""

from __future__ import annotations

import argparse
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

LIMIT = {"adapter": 60, "doctor": 150, "fe": 150, "image": 120, "dic": 120}
"""Seconds of one part on a GPU; a software adapter gets three times as many."""


class Check:
    """The parts that were run, and what each of them told."""

    def __init__(self, folder: Path, scale: str, minutes: float) -> None:
        self.folder, self.scale = folder, scale
        self.ends, self.slow = time.monotonic() + 60.0 * minutes, 1.0
        self.parts: list[dict[str, Any]] = []

    def part(self, name: str, **options: Any) -> list[dict[str, Any]]:
        """Run a part; returns its results, and enters it with what went wrong."""
        left = self.ends - time.monotonic()
        limit = min(LIMIT[name.split(":")[0]] * self.slow, left)
        if limit < 5.0:
            self.parts.append({"part": name, "failed": "left out: the time is up", "results": []})
            print(f"{name:<24} left out: the time is up", flush=True)
            return []
        options |= {"scale": self.scale, "folder": str(self.folder)}
        command = [sys.executable, __file__, "--part", name, "--options", json.dumps(options)]
        start = time.monotonic()
        failed = ""
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
        ) as process:
            try:
                said, _ = process.communicate(timeout=limit)
            except subprocess.TimeoutExpired:
                process.kill()
                said, _ = process.communicate()
                failed = f"stopped after {limit:.0f} s"
        lines = said.splitlines()
        results = [json.loads(one[7:]) for one in lines if one.startswith("RESULT ")]
        told = [one["failed"] for one in results if "failed" in one]
        if process.returncode and not failed:
            others = [one for one in lines if one.strip() and not one.startswith("RESULT ")]
            died = f"died with {process.returncode}" + (f": {others[-1]}" if others else "")
            failed = told[0] if told else died
        seconds = time.monotonic() - start
        self.parts.append(
            {"part": name, "failed": failed[:500], "seconds": seconds, "results": results}
        )
        print(f"{name:<24}{seconds:6.1f} s  {failed or 'done'}", flush=True)
        return results

    def doctor(self, real: str) -> None:
        """Every kernel; one that kills or hangs its process is told, and the others follow."""
        done: list[str] = []
        for _ in range(6):
            results = self.part(f"doctor:{real}", done=done)
            ended = {one["stage"] for one in results if one.get("verdict") not in ("began", None)}
            began = {one["stage"] for one in results if one.get("verdict") == "began"}
            done += sorted(ended | began)
            if not self.parts[-1]["failed"] or not began - ended:
                return


def main() -> int:
    """Run every part, write the report, return 0 if all came to a good end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, default=Path("gpu_check"), metavar="DIR")
    parser.add_argument("--quick", action="store_true", help="smaller cases")
    parser.add_argument("--full", action="store_true", help="the large ones on any adapter")
    parser.add_argument("--adapter", default="", help="part of its name (GPUSIM_ADAPTER)")
    parser.add_argument("--minutes", type=float, help="at most; 6, or 14 on a software adapter")
    parser.add_argument("--write-reference", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--part", help=argparse.SUPPRESS)
    parser.add_argument("--options", default="{}", help=argparse.SUPPRESS)
    choice = parser.parse_args()
    if choice.part or choice.write_reference:
        from benchmarks import gpu_parts

        if choice.write_reference:
            gpu_parts.write_reference()
            return 0
        return gpu_parts.run(choice.part, json.loads(choice.options))
    if choice.adapter:
        os.environ["GPUSIM_ADAPTER"] = choice.adapter
    choice.output.mkdir(parents=True, exist_ok=True)
    check = Check(choice.output.resolve(), "quick", choice.minutes or 6.0)
    found = check.part("adapter")
    if not found or "name" not in found[0]:
        print("no adapter that gpusim can use; the part above says why", file=sys.stderr)
        return 4
    software = bool(found[0]["software"])
    if software:
        check.slow = 3.0
        check.ends += 60.0 * (0.0 if choice.minutes else 8.0)
    check.scale = "quick" if choice.quick or (software and not choice.full) else "full"
    features = found[0]["features"]
    for real in ("f64", "double_single"):
        if real != "f64" or "shader-f64" in features:
            check.doctor(real)
    from benchmarks.gpu_report import FE, IMAGES, trouble, write_report

    for name in IMAGES[check.scale]:
        check.part(f"image:{name}")
    check.part("dic")
    for name in FE[check.scale]:
        check.part(f"fe:{name}")
    stem = re.sub(r"[^a-z0-9]+", "-", found[0]["name"].lower()).strip("-")[:60] or "adapter"
    for path in write_report(check.parts, check.scale, choice.output, stem):
        print(path)
    wrong = trouble(check.parts)
    print("\n".join([f"{len(check.parts)} parts; went wrong: {len(wrong)}", *wrong]))
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
