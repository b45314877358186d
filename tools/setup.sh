#!/usr/bin/env bash
# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
#
# Puts all in place that the lab needs, or that the tests ("tests") or virtual machines ("vm") need, too: Debian packages if they are missing, a virtual
# environment in .work/venv, the path under which Ansible finds this checkout as the collection, and one limit of the kernel
# until the next boot. Does nothing, quickly, when all is there. "quick" is for any user of any Linux: Python packages in .work/quick, and that path.
#
#   setup.sh lab | tests | vm | quick
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/.."

for_lab=(
  podman netavark iptables runc conmon openssh-client     # the containers, and the way into them
  mmdebstrap zstd                                         # their images
  python3-venv                                            # if python3 is Debian's
)
for_tests=(
  git rsync shellcheck nftables
  wireguard-tools wireguard-go                            # the tunnel of docs/operate/hostile_networks.md, with any kernel
  chromium-headless-shell                                 # the page of the report
  zsh fish                                                # shells of persons
)
for_vm=(qemu-system-x86 qemu-utils ipxe-qemu seabios)    # virtual machines

# A system with a user logged in holds about a dozen; kernels allow a user 128, which thirteen systems exceed.
instances=fs.inotify.max_user_instances
instances_wanted=1024

say() { printf 'setup: %s\n' "$*"; }
as_root() { if [[ $EUID -eq 0 ]]; then "$@"; else sudo "$@"; fi; }

install_packages() { # PACKAGE...
  local missing=() package apt=(as_root env DEBIAN_FRONTEND=noninteractive apt-get -qq)
  command -v dpkg-query >/dev/null || { say "this is no Debian: you need the programs of $*"; return; }
  for package; do
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
  # Without it small labs still work, and a large one names the missing limit.
  as_root tee "$file" >/dev/null <<<"$instances_wanted" || say "it stays at $(<"$file")"
}

# The first Python of these that has a version from 3.OLDEST to 3.13 and can make a virtual environment.
find_python() { # OLDEST PYTHON...
  local python oldest=$1
  for python in "${@:2}"; do
    if "$python" -c "import ensurepip, sys, venv; sys.exit(not (3, $oldest) <= sys.version_info[:2] <= (3, 13))" 2>/dev/null; then
      echo "$python"
      return
    fi
  done
  say "no Python from 3.$oldest to 3.13 with the venv module was found (Debian has it in the package python3-venv)" >&2
  return 1
}

make_venv() { # FOLDER INPUTS OLDEST PYTHON...
  [[ $(cat "$1/inputs" 2>/dev/null) == "$2" ]] && "$1/bin/python" -c '' && return
  local python
  python=$(find_python "${@:3}")
  say "making $1 with $python ..."
  rm -rf "$1"
  mkdir -p .work
  "$python" -m venv "$1"
  echo "$2" >"$1/inputs"
}

make_main_venv() {
  make_venv .work/venv "$(sha256sum requirements-lab.txt requirements-dev.txt)" 11 python3.11 python3 python3.12 python3.13 /usr/bin/python3
}

install_tools() { # FOLDER NAME OF THE REQUIREMENTS
  [[ ! -e $1/$2 ]] || return 0
  say "installing the packages of $2.txt into $1 ..."
  # Python compiles modules at their first use; all of it would take longer than to fetch it.
  "$1/bin/python" -m pip install -qq --disable-pip-version-check --no-compile --require-hashes --requirement "$2.txt"
  touch "$1/$2"
}

# The program that looks at metrics, of Debian's package prometheus without its server. Without it one test is left out.
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

case ${1:-} in
  lab)
    install_packages "${for_lab[@]}"
    make_main_venv
    install_tools .work/venv requirements-lab
    ;;
  tests)
    install_packages "${for_lab[@]}" "${for_tests[@]}"
    make_main_venv
    install_tools .work/venv requirements-lab
    install_tools .work/venv requirements-dev
    get_promtool
    ;;
  vm)
    install_packages "${for_lab[@]}" "${for_tests[@]}" "${for_vm[@]}"
    make_main_venv
    install_tools .work/venv requirements-lab
    install_tools .work/venv requirements-dev
    ;;
  quick)
    make_venv .work/quick "$(sha256sum requirements-quick.txt)" 10 python3 python3.13 python3.12 python3.11 python3.10 /usr/bin/python3
    install_tools .work/quick requirements-quick
    link_collection
    exit
    ;;
  *)
    say "expected 'lab', 'tests', 'vm' or 'quick', but found '${1:-}'" >&2
    exit 2
    ;;
esac
raise_limit
link_collection
