# SPDX-License-Identifier: BSD-3-Clause
"""The Python blocks of docs/python.md run, in their order."""
import re

import rangecal


def test_every_block_runs(source, monkeypatch, tmp_path, capsys):
    monkeypatch.chdir(source)
    text = (source / "docs/python.md").read_text().replace("/tmp/rangecal-mine", str(tmp_path / "mine"))
    blocks = re.findall(r"^```python\n(.*?)^```", text, flags=re.M | re.S)
    assert len(blocks) >= 6
    names = {}
    for block in blocks:
        exec(compile(block, "docs/python.md", "exec"), names)
    printed = capsys.readouterr().out
    assert "explained ['beam_offset']" in printed and "degrees, most likely" in printed and "100 % done" in printed
    assert names["mine"].counts["dropped"] == {"missing": 1} and (tmp_path / "mine/recording.yaml").exists()


def test_every_public_function_is_in_the_table(source):
    text = (source / "docs/python.md").read_text()
    for name in rangecal.__all__:
        if name[0].islower():
            assert f"| `{name}(" in text, name
