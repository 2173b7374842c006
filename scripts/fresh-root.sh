#!/usr/bin/env bash
# Runs a command of the committed state of this checkout on a bare system with only Python, make and git: a development
# machine hides missing packages.
#
#   scripts/fresh-root.sh SUITE COMMAND...     e.g. scripts/fresh-root.sh bookworm make demo
#
# SUITE is a suite of debootstrap (bookworm, trixie, noble ...), or a newer one of Debian such as forky, for which the
# script of sid serves. The system is downloaded once, some 300 MB, and cached; the command runs in a copy that is removed
# afterwards, with dist/ if there is one. Needs root, debootstrap and unshare. Settings in the environment:
#
#   PACKAGES="libegl1 ..."      additional packages
#   WITHOUT="libosmesa6 ..."    packages that the distribution does not offer
#   AS_USER=1                   run as a user with sudo; otherwise as root
#   KEEP=1                      do not remove the copy, and print its path
#   FRESH_ROOTS=DIRECTORY       folder of systems and pip's downloads; default ~/.cache/fresh-roots
#   DEBOOTSTRAP_OPTIONS, DEBOOTSTRAP_MIRROR     e.g. --components=main,universe on Ubuntu; a mirror, and a script where
#                               debootstrap has none of that name (gutsy serves all of Ubuntu's)
#
# pip has the configuration of this machine: its variables (PIP_...), /etc/pip.conf, a folder in PIP_FIND_LINKS, certificates.
set -euo pipefail

main() {
  local suite=$1
  shift
  source=$(cd "$(dirname "$0")/.." && pwd)
  local store=${FRESH_ROOTS:-$HOME/.cache/fresh-roots}
  pip_cache=$store/pip${AS_USER:+-user}
  fetch "$suite" "$store/$suite"

  root=$(mktemp -d "$store/run-$suite-XXXXXX")
  trap clean EXIT
  cp -a --reflink=auto "$store/$suite/." "$root"
  prepare
  settings=(HOME="$home" PATH="$path" LANG=C.UTF-8 TERM="${TERM:-dumb}")
  local variable
  while IFS= read -r variable; do settings+=("$variable"); done < <(env | grep -E '^(PIP_|https?_proxy=|no_proxy=)')
  # Separate mounts and processes, so that none are left, however the command ends.
  unshare --mount --pid --fork --kill-child bash -euo pipefail -c \
    "$(declare -p root home source pip_cache settings; declare -f inside)
    inside \"\$@\"" bash "$@"
}

fetch() { # SUITE DIRECTORY
  [ ! -f "$2/.complete" ] || return 0
  rm -rf --one-file-system "$2"
  mkdir -p "$2"
  local mirror=${DEBOOTSTRAP_MIRROR:-}
  [ -n "$mirror" ] || [ -e "/usr/share/debootstrap/scripts/$1" ] || mirror="http://deb.debian.org/debian sid"
  # shellcheck disable=SC2086 # options, and the mirror with its script, are words
  debootstrap --variant=minbase --include=ca-certificates,git,make,python3 ${DEBOOTSTRAP_OPTIONS:-} \
    "$1" "$2" $mirror >"$2.log" 2>&1 || { tail -5 "$2.log"; exit 1; }
  touch "$2/.complete"
}

prepare() { # files and users of the copy
  local file package
  for file in /etc/resolv.conf /etc/hosts /etc/pip.conf /etc/ssl/certs/ca-certificates.crt; do
    [ ! -e "$file" ] || cp -L --remove-destination "$file" "$root$file"
  done
  for package in ${WITHOUT:-}; do
    printf 'Package: %s\nPin: release *\nPin-Priority: -1\n\n' "$package" >>"$root/etc/apt/preferences.d/without"
  done
  home=/root path=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin
  if [ -n "${AS_USER:-}" ]; then
    home=/home/newcomer path=/usr/local/bin:/usr/bin:/bin
    chroot "$root" useradd --create-home --shell /bin/bash newcomer
    mkdir -p "$root/etc/sudoers.d"
    echo 'newcomer ALL=(ALL) NOPASSWD: ALL' >"$root/etc/sudoers.d/newcomer"
  fi
  git clone --quiet "$source" "$root$home/robosim"
  [ ! -d "$source/dist" ] || cp -r "$source/dist" "$root$home/robosim/dist"
  mkdir -p "$pip_cache" "$root$home/.cache/pip"
}

inside() { # mounts, and the command
  mount -t proc proc "$root/proc"
  mount --rbind /dev "$root/dev"
  mount --rbind --read-only /sys "$root/sys"
  mount --bind "$pip_cache" "$root$home/.cache/pip"
  local given place
  for given in "${PIP_FIND_LINKS:-}" "$source/../shared"; do
    [ -d "$given" ] || continue
    place=$given
    [ "$given" != "$source/../shared" ] || place=$home/shared
    mkdir -p "$root$place"
    mount --bind -o ro "$given" "$root$place"
  done
  local wanted="${PACKAGES:-} ${AS_USER:+sudo}"
  [ -z "${wanted// /}" ] || chroot "$root" env DEBIAN_FRONTEND=noninteractive PATH=/usr/sbin:/usr/bin:/sbin:/bin \
    sh -c "apt-get update -qq && apt-get install -y -qq $wanted" >/dev/null
  [ -z "${AS_USER:-}" ] || chroot "$root" chown -R newcomer: "$home/robosim" "$home/.cache"
  # shellcheck disable=SC2016 # the inner shell's own words
  exec chroot ${AS_USER:+--userspec=newcomer:newcomer} "$root" env -i "${settings[@]}" \
    sh -c 'cd ~/robosim && exec "$@"' sh "$@"
}

clean() {
  if [ -n "${KEEP:-}" ]; then echo "The copy is in $root"; else rm -rf --one-file-system "$root"; fi
}

[ $# -ge 2 ] || { sed -n '2,/^set/{/^set/d;s/^# \{0,1\}//;p}' "$0"; exit 2; }
main "$@"; exit # one line: bash reads it before it runs, so this file may be edited meanwhile
