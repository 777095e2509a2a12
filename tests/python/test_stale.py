# SPDX-License-Identifier: BSD-3-Clause
"""Tables of the docs say of which sources they are, and benchmarks/stale.py which are older."""
import re
import shutil
import subprocess
import sys


def stale(root, *arguments):
    return subprocess.run([sys.executable, root / "benchmarks" / "stale.py", *arguments], capture_output=True, text=True)


def test_every_table_names_sources_that_are_there(source):
    result = stale(source)
    assert result.returncode == 0, result.stderr
    assert re.search(r"^\d+ tables are of these sources, \d+ of older ones$", result.stdout, re.M)


def test_a_table_is_stale_once_a_source_changes(source, tmp_path):
    for folder in ("benchmarks", "docs", "core"):
        (tmp_path / folder).mkdir()
    shutil.copy(source / "benchmarks" / "stale.py", tmp_path / "benchmarks")
    (tmp_path / "core" / "a.cpp").write_text("int a;\n")
    digest = stale(tmp_path, "--hash", "core").stdout.strip()
    page = f"<!-- table: rangecal prove; sources: core; hash: {digest} -->\n"
    (tmp_path / "README.md").write_text(page)
    (tmp_path / "docs" / "a.md").write_text("text\n" + page)
    assert stale(tmp_path, "--check").stdout == "2 tables are of these sources, 0 of older ones\n"
    (tmp_path / "core" / "notes.md").write_text("is no source\n")
    assert stale(tmp_path, "--check").returncode == 0
    (tmp_path / "core" / "b.hpp").write_text("")
    result = stale(tmp_path, "--check")
    assert result.returncode == 1
    assert result.stdout.splitlines()[0] == "stale: README.md: rangecal prove"
    assert stale(tmp_path).returncode == 0, "lists, and fails only where it is asked to check"


def test_comments_and_layout_of_a_source_make_no_table_stale(source, tmp_path):
    (tmp_path / "benchmarks").mkdir()
    shutil.copy(source / "benchmarks" / "stale.py", tmp_path / "benchmarks")
    code = tmp_path / "a.cpp"

    def digest(text):
        code.write_text(text)
        return stale(tmp_path, "--hash", "a.cpp").stdout

    plain = digest('int a = 1\'000; const char* s = "// not a comment";\n')
    assert digest('// what it is\nint a  =\n 1\'000; /* and */ const char* s = "// not a comment";') == plain
    assert digest('int a = 1\'000; const char* s = "// no comment";\n') != plain
    assert digest('int a = 1\'001; const char* s = "// not a comment";\n') != plain


def test_what_is_left_out_of_a_folder_makes_no_table_stale(source, tmp_path):
    (tmp_path / "benchmarks").mkdir()
    shutil.copy(source / "benchmarks" / "stale.py", tmp_path / "benchmarks")
    for name in ("a/b/c.cpp", "a/bc.cpp"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("int a;")
    before = stale(tmp_path, "--hash", "a", "!a/b").stdout
    (tmp_path / "a/b/c.cpp").write_text("int b;")
    assert stale(tmp_path, "--hash", "a", "!a/b").stdout == before
    (tmp_path / "a/bc.cpp").write_text("int b;")
    assert stale(tmp_path, "--hash", "a", "!a/b").stdout != before


def test_sources_that_are_not_there_are_refused(source):
    result = stale(source, "--hash", "nowhere")
    assert result.returncode == 1 and result.stderr == "stale.py: there is no nowhere\n"
