# SPDX-FileCopyrightText: rosfleet contributors
# SPDX-License-Identifier: GPL-3.0-or-later
#
# 'make' lists what there is. Every target does its own set-up.
.DEFAULT_GOAL := help
.PHONY: help setup setup-lab setup-vm lab lab-vm lab-tests demo rehearse lab-down quick check lint sanity unit molecule systems bench bench-site test test-long test-machines test-faults test-interop test-matrix checkout docs findings format house references readme pictures lock copies build
.NOTPARALLEL:

export LC_ALL := C.UTF-8
PYTHON := .work/venv/bin/python
LAYOUT := single_computer

help: ## list the targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / { printf "  make %-10s %s\n", $$1, $$2 }' Makefile

setup: ## what the tests need: Debian packages, tools in .work/venv
	@bash tools/setup.sh tests

# What a demonstration or a rehearsal needs. Where the tests have more, it stays.
setup-lab:
	@bash tools/setup.sh lab

lab: setup-lab ## build the image of the lab's computers
	@$(PYTHON) lab/lab.py image

# Virtual machines.
setup-vm:
	@bash tools/setup.sh vm

lab-vm: setup-vm ## build the disks of the lab's virtual machines, Debian 12 and 13 (lab/vm.py; needs root, no KVM)
	@$(PYTHON) lab/vm.py image bookworm trixie
	@$(PYTHON) lab/vm.py image --disk wifi bookworm

# With the packages that tests alone need.
lab-tests: setup
	@$(PYTHON) lab/lab.py image --full

demo: lab ## robots on real systems, from nothing to a fleet that talks (LAYOUT=single_computer, multi_computer, identical_robots or tunnel)
	@$(PYTHON) lab/demo.py --layout $(LAYOUT)

rehearse: lab ## your own inventory on real systems (INVENTORY=<folder>; FAULTS=no_forwarding,...; see docs/start/rehearse.md)
	@$(PYTHON) lab/rehearse.py --inventory "$(INVENTORY)" --faults "$(FAULTS)" --suites "$(SUITES)" $(if $(OVERLAP),--overlap) $(if $(KEEP),--keep)

lab-down: setup-lab ## remove everything that the lab made: containers, networks, images that no other checkout uses; also of a rehearsal
	@$(PYTHON) lab/vm.py down --all
	@$(PYTHON) lab/lab.py down --all

test: lab-tests setup-vm ## every test
	@$(PYTHON) tools/test.py

# Python's caches are out of the tree, or 'reuse' would read files that tests are writing.
quick: ## in two minutes, for any user of any Linux with Python 3.10 to 3.13: lint, types, unit tests; without those that need root, are slow, or run whole programs
	@bash tools/setup.sh quick
	@PYTHONDONTWRITEBYTECODE= PYTHONPYCACHEPREFIX="$(CURDIR)/.work/pycache" .work/quick/bin/python tools/test.py quick

check: setup lab ## what one runs before every commit: lint, types, the unit tests that are not slow, one pair of robots end to end
	@$(PYTHON) tools/test.py check

lint: setup ## linters, types, and checks of files
	@$(PYTHON) tools/test.py lint

sanity: setup ## ansible-test sanity (CORE=2.16, 2.18 or 2.20: that of another ansible-core)
	@$(PYTHON) tools/test.py $(if $(CORE),long:sanity_$(CORE),sanity)

unit: setup ## unit tests
	@$(PYTHON) tools/test.py unit

molecule: lab-tests ## the roles in containers: check, converge, idempotence, verify, reboot, verify, teardown
	@$(PYTHON) tools/test.py molecule

systems: lab-tests setup-vm ## injected faults and the commands of the README, on real systems
	@$(PYTHON) tools/test.py systems

test-long: bench-site ## what takes too long for 'make test': losses of minutes, Debian 11, and the bench
	@$(PYTHON) tools/test.py long

test-machines: lab-vm ## what depends on a kernel and udev, in virtual machines of Debian 12 and 13 (two hours; needs root, no KVM; nothing should run beside it)
	@$(PYTHON) tools/test.py machines

test-faults: lab-tests ## the catalogue of faults on real systems, and its table in tests/evidence/faults.md (an hour); FUZZ=200 SEED=1: drawn ones
	@$(if $(FUZZ),$(PYTHON) tests/faults/fuzz.py --number $(FUZZ) --seed $(or $(SEED),1) --labs 3,$(PYTHON) tools/test.py faults)

test-interop: checkout lab-tests ## the bundled nodes with those of multimaster_fkie 1.3.2 (FKIE=checkout), or of fkie_mas 5.7.0 (MAS=checkout)
	@$(if $(MAS),bash tests/interop/needs.sh)
	@$(if $(MAS),MAS="$(abspath $(MAS))",FKIE="$(abspath $(FKIE))") $(PYTHON) tools/test.py interop

test-matrix: lab ## four versions of ansible-core on the controller by three releases of Debian and three places of ROS on the robots, and their table in docs/start/machines.md (half an hour)
	@$(PYTHON) tests/matrix/run.py --page

checkout:
	@test -e "$(MAS)/fkie_mas_discovery/nodes/mas-discovery" -a -e "$(MAS)/fkie_mas_sync/nodes/mas-sync" \
		-o -e "$(FKIE)/fkie_master_discovery/nodes/master_discovery" -a -e "$(FKIE)/fkie_master_sync/nodes/master_sync" \
		|| { echo "make test-interop needs FKIE=<folder of a checkout of multimaster_fkie 1.3.2> or MAS=<of fkie_mas 5.7.0>, but FKIE is '$(FKIE)', and MAS is '$(MAS)'." >&2; exit 1; }

bench: lab-tests ## how fast topics cross, beside multimaster_fkie where FKIE=<checkout> is given (half an hour; KEEP=yes: into docs)
	@$(PYTHON) tests/bench/network/network.py $(if $(FKIE),--fkie "$(abspath $(FKIE))") $(if $(KEEP),--keep)
	@$(PYTHON) tests/bench/network/relay.py
	@$(if $(FKIE),$(PYTHON) tests/bench/network/relay.py --fkie "$(abspath $(FKIE))")

bench-site: lab-tests ## the second run of site.yml beside a playbook of the usual tasks, on 13 systems; its growth to 100 (a quarter of an hour; KEEP=yes: into docs)
	@$(PYTHON) tests/bench/site/site.py
	@$(PYTHON) tests/bench/site/growth.py $(if $(KEEP),--keep)

format: setup ## format the Python files
	@.work/venv/bin/ruff check --quiet --fix . && .work/venv/bin/ruff format --quiet .

house: setup ## figures of the code: rooms, imports, long functions (REV=revision of git)
	@$(PYTHON) tools/house.py $(if $(REV),--rev $(REV))

docs: setup ## a site of all pages, modules, roles, filters and variables, with a search, in .work/docsite/html; each link is looked at
	@$(PYTHON) tools/docsite/build.py

findings: setup ## write the pages of the findings (docs/findings) out of the table of faults
	@PYTHONPATH=.work/collections $(PYTHON) tools/findings.py

references: setup ## write the tables of the references (variables, options, checks, ports, files, parameters, metrics) out of the code
	@PYTHONPATH=.work/collections $(PYTHON) tools/references.py

readme: setup ## write the tables of what was measured into their pages
	@PYTHONPATH=.work/collections $(PYTHON) tools/readme.py

pictures: setup ## write the pictures of the pages (docs/images/*.svg) out of the code and the shipped inventories
	@PYTHONPATH=.work/collections $(PYTHON) -m tools.pictures

lock: ## write requirements-lab.txt and -dev.txt, with the hashes of all packages, out of the files .in (UPGRADE=yes: newer versions)
	@bash tools/lock.sh $(UPGRADE)

copies: setup ## write what is made of other files: copies, and RETURN of the modules that measure
	@python3 tools/copies.py
	@PYTHONPATH=.work/collections $(PYTHON) tools/contract.py

build: setup-lab ## the collection as an archive in .work/dist, out of the files that git has
	@$(PYTHON) tools/package.py .work/dist
