# SPDX-License-Identifier: MIT
"""Collects the READMEs and host/docs into one folder for MkDocs, runs the notebook; links between them follow, links to sources become their names.

    docs.py -o FOLDER        writes FOLDER/mkdocs.yml and FOLDER/docs/…
"""
import argparse
import contextlib
import io
import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOK = "host/docs/notebook.py"
_LINK = re.compile(r"(!?)\[([^\]]*)\]\(([^)\s#]+)(#[^)\s]*)?\)")


def pages():
    """{source: place in the site} of every Markdown file of the project, and of the notebook."""
    names = subprocess.run(["git", "ls-files", "*.md"], cwd=ROOT, check=True, capture_output=True, text=True).stdout.split()
    site = {n: n.removeprefix("host/docs/") if n.startswith("host/docs/") else f"readme/{n}" for n in names}
    return {**site, NOTEBOOK: "notebook.md"}


def rewritten(source, text, site):
    """Text whose relative links lead to the pages' places; returns (text, broken links)."""
    broken = []

    def follow(match):
        mark, label, target, anchor = match.groups()
        if "://" in target or target.startswith("mailto:"):
            return match.group(0)
        if source.startswith("host/docs/") and target.startswith(("readme/", "figures/")):
            return match.group(0)
        path = os.path.normpath(os.path.join(os.path.dirname(source), target))
        if path in site:
            place = os.path.relpath(site[path], os.path.dirname(site[source]) or ".")
            return f"{mark}[{label}]({place}{anchor or ''})"
        if not (ROOT / path).exists():
            broken.append(f"{source}: {target}")
        return f"{label} (`{path}`)"
    return _LINK.sub(follow, text), broken


def cells(source):
    """[(is_text, lines)] of a notebook in the percent format; what stands before the first cell is left out."""
    found = []
    for line in source.splitlines():
        if line.startswith("# %%"):
            found.append(("[markdown]" in line, []))
        elif found:
            found[-1][1].append(line)
    return found


def executed(path):
    """A notebook run cell by cell: Markdown with the code and what it printed.  What it raises goes on to the caller."""
    names, parts = {"__name__": "notebook"}, []
    for is_text, lines in cells(Path(path).read_text(encoding="utf-8")):
        if is_text:
            parts.append("\n".join(line.removeprefix("#").removeprefix(" ") for line in lines).strip())
            continue
        code = "\n".join(lines).strip()
        said = io.StringIO()
        with contextlib.redirect_stdout(said):
            exec(compile(code, str(path), "exec"), names)
        parts.append(f"```python\n{code}\n```")
        if said.getvalue():
            parts.append(f"```text\n{said.getvalue().rstrip()}\n```")
    return "\n\n".join(parts) + "\n"


def figures(folder):
    """The site's figures, made by the programs from the example that they write: {name: command as a reader would type it}."""
    programs = Path(os.environ.get("IMUCAL_BIN", ROOT / "build/bin"))
    folder.mkdir(parents=True, exist_ok=True)
    made = {"look.png": ["look", "run1.csv", "--no-ml", "-o", str(folder.resolve() / "look.png")]}
    with tempfile.TemporaryDirectory() as example:
        subprocess.run([programs / "imucal", "example", example], check=True, capture_output=True)
        for words in made.values():
            subprocess.run([programs / "imucal", *words], cwd=example, check=True, capture_output=True)
    return sorted(made)


def missing_figures(folder):
    """Figures that a page shows and nobody made."""
    shown = {(page, target) for page in folder.rglob("*.md") for target in re.findall(r"!\[[^\]]*\]\((figures/[^)]+)\)", page.read_text(encoding="utf-8"))}
    return [f"{page.relative_to(folder)}: {target}" for page, target in sorted(shown) if not (page.parent / target).exists()]


def main():
    """Write the folder; status 1 where a link leads nowhere."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", required=True)
    out = Path(parser.parse_args().output)
    sys.path.insert(0, str(ROOT / "host/python"))
    shutil.rmtree(out / "docs", ignore_errors=True)
    site, broken = pages(), []
    for source, place in site.items():
        text = executed(ROOT / source) if source == NOTEBOOK else (ROOT / source).read_text(encoding="utf-8")
        text, lost = rewritten(source, text, site)
        broken += lost
        (out / "docs" / place).parent.mkdir(parents=True, exist_ok=True)
        (out / "docs" / place).write_text(text, encoding="utf-8")
    drawn = figures(out / "docs/figures")
    broken += missing_figures(out / "docs")
    shutil.copy(ROOT / "host/docs/mkdocs.yml", out / "mkdocs.yml")
    for link in broken:
        print(f"docs.py: a link that leads nowhere: {link}", file=sys.stderr)
    print(f"docs: {len(site)} pages, figures made: {len(drawn)}, {len(broken)} broken links")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
