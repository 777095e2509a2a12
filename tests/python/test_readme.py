# SPDX-License-Identifier: BSD-3-Clause
"""The Python of README.md runs."""
import re


def test_blocks_run_and_assert(source, monkeypatch):
    monkeypatch.chdir(source)
    blocks = re.findall(r"^```python\n(.*?)^```", (source / "README.md").read_text(), flags=re.M | re.S)
    assert blocks
    for block in blocks:
        assert block.splitlines()[-1].startswith("assert ")
        exec(compile(block, "README.md", "exec"), {})
