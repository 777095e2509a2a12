# SPDX-License-Identifier: BSD-3-Clause
"""Shipped data: every folder says where it is from, and its files are the ones whose checksums it states."""
import hashlib
import re


def test_every_folder_of_data_has_origin_licence_and_right_checksums(source):
    data = source / "notebooks_data"
    everything = (data / "README.md").read_text()
    checked = 0
    for folder in sorted(path for path in data.iterdir() if path.is_dir() and path.name != "__pycache__"):
        readme = folder / "README.md"
        assert readme.exists() or f"`{folder.name}`" in everything, folder
        files = {str(path.relative_to(folder)) for ending in ("csv", "yaml") for path in folder.rglob(f"*.{ending}")}
        if not files or folder.name == "notebooks":   # keys are held by the commitments, sources by what they print
            continue
        if (folder / "recording.yaml").exists():
            text = readme.read_text()
            assert "Origin:" in text and "Licence:" in text, readme
        else:
            text = (folder / "SHA256SUMS").read_text()
        digests = {name: digest for digest, name in re.findall(r"^([0-9a-f]{64})  (\S+)$", text, flags=re.M)}
        assert files <= set(digests), folder
        for name, digest in digests.items():
            assert hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest, folder / name
            checked += 1
    assert checked >= 150
