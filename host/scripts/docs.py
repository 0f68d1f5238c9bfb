# SPDX-License-Identifier: MIT
"""Collects the READMEs and host/docs into one folder for MkDocs; links between them follow, links to sources become their names.

    docs.py -o FOLDER        writes FOLDER/mkdocs.yml and FOLDER/docs/…
"""
import argparse
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s#]+)(#[^)\s]*)?\)")


def pages():
    """{source: place in the site} of every Markdown file of the project."""
    names = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    return {n: n.removeprefix("host/docs/") if n.startswith("host/docs/") else f"readme/{n}" for n in names}


def rewritten(source, text, site):
    """Text whose relative links lead to the pages' places; returns (text, broken links)."""
    broken = []

    def follow(match):
        mark, label, target, anchor = match.groups()
        if "://" in target or target.startswith("mailto:"):
            return match.group(0)
        if source.startswith("host/docs/") and target.startswith("readme/"):
            return match.group(0)
        path = os.path.normpath(os.path.join(os.path.dirname(source), target))
        if path in site:
            place = os.path.relpath(site[path], os.path.dirname(site[source]) or ".")
            return f"{mark}[{label}]({place}{anchor or ''})"
        if not (ROOT / path).exists():
            broken.append(f"{source}: {target}")
        return f"{label} (`{path}`)"
    return _LINK.sub(follow, text), broken


def main():
    """Write the folder; status 1 where a link leads nowhere."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", required=True)
    out = Path(parser.parse_args().output)
    shutil.rmtree(out / "docs", ignore_errors=True)
    site, broken = pages(), []
    for source, place in site.items():
        text, lost = rewritten(source, (ROOT / source).read_text(encoding="utf-8"), site)
        broken += lost
        (out / "docs" / place).parent.mkdir(parents=True, exist_ok=True)
        (out / "docs" / place).write_text(text, encoding="utf-8")
    shutil.copy(ROOT / "host/docs/mkdocs.yml", out / "mkdocs.yml")
    for link in broken:
        print(f"docs.py: a link that leads nowhere: {link}", file=sys.stderr)
    print(f"docs: {len(site)} pages, {len(broken)} broken links")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
