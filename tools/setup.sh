#!/usr/bin/env bash
# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
#
# Puts in place what the tests and the lab need: Debian packages where they are missing, a virtual environment in .work/venv,
# promtool, the path under which Ansible finds this checkout as the collection, and one limit of the kernel until the next boot.
# Does nothing, quickly, when all is there.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

packages=(
  git rsync shellcheck openssh-client nftables            # tests
  podman netavark iptables runc conmon mmdebstrap zstd    # lab
  wireguard-tools wireguard-go                            # the tunnel of docs/operate/hostile_networks.md, with any kernel
  chromium-headless-shell                                 # the page of the report
  python3-venv                                            # where python3 is Debian's
)
stamp=.work/venv/stamp
inputs=$(sha256sum requirements-dev.txt)

# A system with somebody logged in holds about a dozen; kernels allow a user 128, which thirteen systems exceed.
instances=fs.inotify.max_user_instances
instances_wanted=1024

say() { printf 'setup: %s\n' "$*"; }
as_root() { if [[ $EUID -eq 0 ]]; then "$@"; else sudo "$@"; fi; }

install_packages() {
  local missing=() package apt=(as_root env DEBIAN_FRONTEND=noninteractive apt-get -qq)
  command -v dpkg-query >/dev/null || { say "this is no Debian: you need podman, mmdebstrap, zstd, rsync and shellcheck"; return; }
  for package in "${packages[@]}"; do
    dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null | grep -qx installed || missing+=("$package")
  done
  [[ ${#missing[@]} -gt 0 ]] || return 0
  say "installing ${missing[*]} with apt ..."
  "${apt[@]}" update
  "${apt[@]}" install --yes --no-install-recommends "${missing[@]}" >/dev/null
}

raise_limit() {
  local file=/proc/sys/${instances//.//}
  [[ $(<"$file") -lt $instances_wanted ]] || return 0
  say "raising $instances from $(<"$file") to $instances_wanted until the next boot ..."
  # Without it small labs still work, and a large one says what is missing.
  as_root tee "$file" >/dev/null <<<"$instances_wanted" || say "it stays at $(<"$file")"
}

# The first Python that ansible-core runs on and that can make a virtual environment.
find_python() {
  local python
  for python in python3.11 python3 python3.12 python3.13 /usr/bin/python3; do
    if "$python" -c 'import ensurepip, sys, venv; sys.exit(not (3, 11) <= sys.version_info[:2] <= (3, 13))' 2>/dev/null; then
      echo "$python"
      return
    fi
  done
  say "no Python from 3.11 to 3.13 with the venv module was found" >&2
  return 1
}

make_venv() {
  [[ -x .work/venv/bin/python && $(cat "$stamp" 2>/dev/null) == "$inputs" ]] && .work/venv/bin/python -c '' && return
  local python
  python=$(find_python)
  say "making .work/venv with $python and the tools of requirements-dev.txt (about half a minute) ..."
  rm -rf .work/venv
  mkdir -p .work
  "$python" -m venv .work/venv
  .work/venv/bin/python -m pip install -qq --disable-pip-version-check --require-hashes --requirement requirements-dev.txt
  echo "$inputs" >"$stamp"
}

# What looks at metrics, of Debian's package prometheus without its server. Without it one test is left out.
get_promtool() {
  [[ ! -x .work/bin/promtool ]] && command -v dpkg-deb >/dev/null || return 0
  local folder
  folder=$(mktemp -d)
  say "fetching promtool of Debian's package prometheus ..."
  mkdir -p .work/bin
  if (cd "$folder" && chmod 755 . && apt-get -qq download prometheus) && dpkg-deb --fsys-tarfile "$folder"/*.deb | tar x -C "$folder" ./usr/bin/promtool; then
    mv "$folder/usr/bin/promtool" .work/bin/
  else
    say "there is none: the test with it is left out"
  fi
  rm -rf "$folder"
}

link_collection() {
  mkdir -p .work/collections/ansible_collections/rosfleet
  ln -sfn "$PWD" .work/collections/ansible_collections/rosfleet/multimaster
}

install_packages
raise_limit
make_venv
get_promtool
link_collection
