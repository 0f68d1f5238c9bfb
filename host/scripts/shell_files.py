# SPDX-License-Identifier: MIT
"""Man pages and shell completions, made from what the programs say of themselves.

    shell_files.py IMUCAL -o FOLDER      writes man1/imucal.1 man1/imucal-dp.1 …, bash/imucal, zsh/_imucal
"""
import argparse
import os
import re
import subprocess
import sys
from pathlib import Path


def help_of(command):
    """Text of COMMAND --help."""
    done = subprocess.run([*command, "--help"], capture_output=True, text=True, env={**os.environ, "COLUMNS": "79"})
    if done.returncode != 0:
        sys.exit(f"shell_files.py: {' '.join(command)} --help: exit {done.returncode}: {done.stderr.strip()}")
    return done.stdout


def subcommands(text):
    """[(name, one line)] of `imucal --help`."""
    return re.findall(r"^  ([a-z]+) +(\S.*)$", text, re.M)


def options(text):
    """Long options a help text names."""
    return sorted(set(re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", text)))


def nested(text):
    """Subcommands of a program (CLI11 lists them under "Subcommands:")."""
    part = re.search(r"^Subcommands:\n((?:  .*\n?)+)", text, re.M)
    return re.findall(r"^  ([a-z][a-z-]*)(?: |$)", part.group(1), re.M) if part else []


def roff(text):
    """Text as it is, safe for roff."""
    lines = [line.replace("\\", "\\e").replace("-", "\\-") for line in text.rstrip().splitlines()]
    return "\n".join("\\&" + line if line.startswith((".", "'")) else line for line in lines)


def man_page(name, line, text, version, others):
    """A man page whose description is the help text."""
    also = ", ".join(f"\\fB{other}\\fP(1)" for other in others if other != name)
    return (f'.TH {name.upper()} 1 "" "imucal {version}" "imucal"\n.SH NAME\n{name} \\- {roff(line)}\n.SH SYNOPSIS\n\\fB{name.replace("-", " ", 1)}\\fP ...\n'
            f".SH DESCRIPTION\n.nf\n{roff(text)}\n.fi\n.SH EXIT STATUS\n0 done; 1 done, and the answer is negative; 2 usage; 3 bad input data; 4 device or link.\n"
            f".SH SEE ALSO\n{also}\n")


def bash(words):
    """Completion: subcommands, then options or files."""
    cases = "\n".join(f'    {name}) words="{" ".join(inner + opts)}" ;;' for name, (inner, opts) in words.items())
    return f"""# bash completion for imucal; made from imucal --help
_imucal() {{
  local current=${{COMP_WORDS[COMP_CWORD]}} words
  COMPREPLY=()
  if [ "$COMP_CWORD" -eq 1 ]; then
    COMPREPLY=($(compgen -W "{' '.join(words)} --help --version" -- "$current"))
    return
  fi
  case ${{COMP_WORDS[1]}} in
{cases}
    *) words="" ;;
  esac
  COMPREPLY=($(compgen -W "$words" -- "$current"))
  case $current in -*) ;; *) COMPREPLY+=($(compgen -f -- "$current")) ;; esac
}}
complete -o filenames -F _imucal imucal
"""


def zsh(words, lines):
    """The same for zsh."""
    described = "\n".join(f"    '{name}:{line.replace(chr(39), '').replace(':', ' ')}'" for name, line in lines)
    cases = "\n".join(f"    {name}) compadd -- {' '.join(inner + opts)}; _files ;;" for name, (inner, opts) in words.items())
    return f"""#compdef imucal
# zsh completion for imucal; made from imucal --help
_imucal() {{
  local -a subcommands
  subcommands=(
{described}
  )
  if (( CURRENT == 2 )); then
    _describe subcommand subcommands
    return
  fi
  case $words[2] in
{cases}
  esac
}}
_imucal "$@"
"""


def main():
    """Write all files."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("imucal")
    parser.add_argument("-o", "--output", required=True)
    given = parser.parse_args()
    top = help_of([given.imucal])
    version = subprocess.run([given.imucal, "--version"], capture_output=True, text=True).stdout.split()[-1]
    listed = subcommands(top)
    names = ["imucal"] + [f"imucal-{name}" for name, _ in listed]
    out = Path(given.output)
    for folder in ("man1", "bash", "zsh"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    (out / "man1/imucal.1").write_text(man_page("imucal", "static thermal calibration of inertial sensors", top, version, names))
    words = {}
    for name, line in listed:
        text = help_of([given.imucal, name])
        inner = nested(text)
        whole = text + "".join(f"\n\n{name} {sub}:\n" + help_of([given.imucal, name, sub]) for sub in inner)
        (out / f"man1/imucal-{name}.1").write_text(man_page(f"imucal-{name}", line, whole, version, names))
        words[name] = (inner, options(whole))
    (out / "bash/imucal").write_text(bash(words))
    (out / "zsh/_imucal").write_text(zsh(words, listed))


if __name__ == "__main__":
    main()
