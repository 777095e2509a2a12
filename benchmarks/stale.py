#!/usr/bin/env python3
# SPDX-License-Identifier: BSD-3-Clause
"""Which printed tables are older than the sources that they depend on.

A table in README.md or docs has a line below it that says how it was made, on what it depends, and what that was then:

    <!-- table: COMMAND; sources: PATH...; hash: HEX -->

A PATH after a "!" is left out of those before it. Comments and the layout of C++ do not count.
`stale.py` lists the tables whose sources have changed, `--check` also ends with 1 if there is one. `--hash PATH...` prints
the hash for a new line, `--at COMMIT` that of an older commit.
"""
import argparse
import hashlib
import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
TABLE = re.compile(r"<!-- table: (?P<command>.*?); sources: (?P<sources>.*?); hash: (?P<hash>[0-9a-f]+) -->", re.S)
CODE = {".cpp", ".hpp", ".py", ".txt", ".cmake"}


# Raw strings, strings and characters, which may hold what looks like a comment; comments and spaces, as the only group.
TOKEN = re.compile(rb'R"(?P<end>[^(\s]*)\(.*?\)(?P=end)"|"(?:\\.|[^"\\\n])*"|(?<!\w)\'(?:\\.|[^\'\\\n])+\''
                   rb'|(?P<nothing>(?:\s|//[^\n]*|/\*.*?\*/)+)', re.S)


def meaning(name, content):
    """Of C++ a source without its comments and its layout; any other as it is."""
    if not name.endswith((".cpp", ".hpp")):
        return content
    return TOKEN.sub(lambda token: b" " if token["nothing"] else token[0], content).strip()


def digest(files):
    whole = hashlib.sha256()
    for name, content in sorted(files):
        whole.update(name.encode() + b"\0" + hashlib.sha256(meaning(name, content)).digest())
    return whole.hexdigest()[:16]


def parted(paths):
    """What is taken, and what is left out of it."""
    return [p for p in paths if p[0] != "!"], tuple(p[1:] for p in paths if p[0] == "!")


def is_under(name, folders):
    return any(name == folder or name.startswith(folder + "/") for folder in folders)


def files_here(paths):
    taken, left_out = parted(paths)
    for path in taken:
        top = ROOT / path
        if not top.exists():
            sys.exit(f"stale.py: there is no {path}")
        for file in [top] if top.is_file() else top.rglob("*"):
            if file.is_file() and file.suffix in CODE and not is_under(str(file.relative_to(ROOT)), left_out):
                yield str(file.relative_to(ROOT)), file.read_bytes()


def files_at(commit, paths):
    def git(*arguments):
        return subprocess.run(["git", "-C", str(ROOT), *arguments], check=True, capture_output=True).stdout
    taken, left_out = parted(paths)
    for name in git("ls-tree", "-r", "--name-only", commit, "--", *taken).decode().splitlines():
        if Path(name).suffix in CODE and not is_under(name, left_out):
            yield name, git("show", f"{commit}:{name}")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="end with 1 if a table is stale")
    parser.add_argument("--hash", nargs="+", metavar="PATH", help="print the hash of these sources")
    parser.add_argument("--at", metavar="COMMIT", help="with --hash: of that commit")
    options = parser.parse_args()
    if options.hash:
        print(digest(files_at(options.at, options.hash) if options.at else files_here(options.hash)))
        return 0
    stale = fresh = 0
    for page in [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]:
        for table in TABLE.finditer(page.read_text()):
            if digest(files_here(table["sources"].split())) == table["hash"]:
                fresh += 1
                continue
            stale += 1
            print(f"stale: {page.relative_to(ROOT)}: {' '.join(table['command'].split())}")
    print(f"{fresh} tables are of these sources, {stale} of older ones")
    return 1 if options.check and stale else 0


if __name__ == "__main__":
    sys.exit(main())
