"""Distributions of the committed state: built twice, compared, checked.

    python scripts/make_dist.py [FOLDER]

Clones the repository into two folders, builds a source archive and a wheel in each with hatchling, and fails unless
both pairs are byte-identical. Times inside are those of the last commit (`SOURCE_DATE_EPOCH`). Then `twine check` and
`check-wheel-contents` run, licences of fonts, networks and plans must be inside, and the size is limited. FOLDER, by
default `dist`, then holds the two files, whose digests are printed.
"""

import hashlib
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
#: Upper limit of each file [bytes].
LARGEST = 60_000_000
LICENCES = ("LICENSE", "assets/LICENSES.md")
FONT_LICENCE = "docs/_static/fonts/OFL.txt"


def main(folder: Path) -> None:
    """Build, compare, check, and copy into a folder."""
    epoch = subprocess.check_output(["git", "log", "-1", "--format=%ct"], cwd=ROOT, text=True).strip()
    with tempfile.TemporaryDirectory() as place:
        first, second = (build(Path(place) / name, epoch) for name in ("one", "another/folder"))
        differing = [file.name for file in first if digest(file) != digest(second[0].parent / file.name)]
        if differing or len(first) != len(second):
            sys.exit(f"Two builds of the same commit differ: {' '.join(differing)}")
        check(first)
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        for file in first:
            print(f"{digest(file)}  {file.stat().st_size / 1e6:.1f} MB  {folder / file.name}")
            shutil.copy(file, folder)


def build(clone: Path, epoch: str) -> list[Path]:
    """Build both distributions in a new clone of the committed state; return their files."""
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
    command = [sys.executable, "-m", "hatchling", "build", "--target", "sdist", "--target", "wheel"]
    environment = {**os.environ, "SOURCE_DATE_EPOCH": epoch}
    subprocess.run(command, cwd=clone, check=True, stdout=subprocess.DEVNULL, env=environment)
    return sorted((clone / "dist").iterdir())


def check(files: list[Path]) -> None:
    """Exit with a sentence if the metadata, the contents, the licences or the size are wrong."""
    subprocess.run([sys.executable, "-m", "twine", "check", "--strict", *map(str, files)], check=True)
    wheel = next(file for file in files if file.suffix == ".whl")
    subprocess.run([sys.executable, "-m", "check_wheel_contents", str(wheel)], cwd=ROOT, check=True)
    for file in files:
        missing = [name for name in licences_of(file) if not any(n.endswith(name) for n in names_in(file))]
        if missing:
            sys.exit(f"{file.name} lacks {' '.join(missing)}")
        if file.stat().st_size > LARGEST:
            sys.exit(f"{file.name} has {file.stat().st_size / 1e6:.1f} MB, at most {LARGEST / 1e6:.0f} MB")


def licences_of(file: Path) -> tuple[str, ...]:
    """Names of licence files that a distribution must hold; only the source archive has the fonts of the pages."""
    return LICENCES if file.suffix == ".whl" else (*LICENCES, FONT_LICENCE)


def names_in(file: Path) -> list[str]:
    """Names of the files in a distribution."""
    if file.suffix == ".whl":
        with zipfile.ZipFile(file) as archive:
            return archive.namelist()
    with tarfile.open(file) as archive:
        return archive.getnames()


def digest(file: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(file.read_bytes()).hexdigest()


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "dist")
