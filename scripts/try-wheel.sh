#!/usr/bin/env bash
# Installs the wheel of dist/ alone into a new environment, and uses it in an empty folder: doctor, a search, a trace, and
# the commands of the README, the tutorial, and further pages. Nothing is imported from the checkout.
#
#   scripts/try-wheel.sh [PAGE...]     in the checkout of scripts/fresh-root.sh; e.g. docs/tasks/*.md
set -euo pipefail
cd "$(dirname "$0")/.."
python3 scripts/system_packages.py --venv
python3 -m venv ~/wheel
~/wheel/bin/pip install --quiet dist/*.whl
pages=()
for page in README.md docs/tutorial.md "$@"; do pages+=("$PWD/$page"); done
runner=$PWD/tests/docs/run_page.py
mkdir ~/empty
cd ~/empty
python=~/wheel/bin/python
PATH=~/wheel/bin:$PATH
"$python" --version
robosim --version
robosim doctor
robosim episode flat --seed 1 --max-steps 50 --no-video --out out/first
robosim trace flat --tx 7,7 --grid 1 --out out/radio
exec "$python" "$runner" "${pages[@]}"
