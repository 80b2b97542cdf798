# `make run` and `make test` need no ROS: .ci/environment fills .venv with the ROS 2 wheels.
# On a machine with ROS 2 Jazzy the same tree is built with colcon instead; see README.md.

SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help run test test-long check bench lint language docs films wheel clean
.SILENT:

# What a sourced ROS installation, or another environment of ROS wheels, leaves in the shell
# would be mixed with the packages of .venv.
ifneq ($(AMENT_PREFIX_PATH)$(_ROS_WHEELS_BOOTSTRAP_COMPLETE),)
unexport LD_LIBRARY_PATH
endif
unexport PYTHONPATH PYTHONHOME AMENT_PREFIX_PATH COLCON_PREFIX_PATH RMW_IMPLEMENTATION
unexport _ROS_WHEELS_BOOTSTRAP_COMPLETE PIP_USER PIP_TARGET PIP_PREFIX

# Tests start hundreds of processes; without bytecode each of them would read all sources anew.
unexport PYTHONDONTWRITEBYTECODE

test test-long check: export ROS_PYTHON_CHECK_FIELDS := 1
test test-long check: export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST

# $(call stage,name,command): one headed stage, and a clear line where it stops.
stage = printf '\n== %s\n' '$(1)'; $(2) || { printf '\nstopped at: %s\n' '$(1)' >&2; exit 1; }

# $(call side_by_side,name,workers,tests): a file for each worker at a time, so that none compiles
# what another one does, those that take longest first (test/conftest.py). In parts, since a process
# keeps what it has compiled: 80 MB for a kind of scene. A test that hangs in compiled code hears no
# signal: its worker says where, and dies; another one would begin its file again, so the tests end.
side_by_side = $(call stage,tests side by side: $(1) (pytest),$(call workers,$(2),$(3)))
workers = .venv/bin/python -m pytest -m 'not long' -n $(1) --dist loadfile --no-loadscope-reorder \
	-o faulthandler_timeout=900 -o faulthandler_exit_on_timeout=true --max-worker-restart 0 $(2)
# $(call types_beside,command): mypy, which takes one core, beside it; what it says stands at the end.
types_beside = { .venv/bin/mypy >.venv/mypy.log 2>&1 & types=$$!; $(1); tests=$$?; \
	wait $$types; types=$$?; cat .venv/mypy.log; [ $$tests$$types = 00 ]; }
comma := ,
# Random examples in `make test-long`, in multiples of those in `make test`.
EXAMPLES ?= 20
# Nodes wait more than they compute, so the last part has two workers for each core.
twice := $$(( 2 * $$(nproc) < 8 ? 2 * $$(nproc) : 8 ))

help:
	echo 'make run     set up .venv, then show a fabric that sags, sways and answers a push'
	echo '             (ARGS="..." is handed on; PYTHON=python3.12 chooses the Python)'
	echo 'make test    set up .venv, then lint, types and all tests (ARGS="..." for pytest)'
	echo 'make check   lint, types and a selection of tests for the working day'
	echo 'make test-long  what takes too long for make test, and whether pages say what commands print'
	echo 'make bench   time this checkout and another commit in turns (REF=HEAD~1; ARGS="--cases S1")'
	echo 'make lint    set up .venv, then lint and types only'
	echo 'make language  count what docs/style.md asks of names and texts (ARGS="--rooms")'
	echo 'make docs    set up .venv, then build the documentation site in build/site'
	echo 'make films   set up .venv, then make the films of docs/gallery.md anew (half an hour)'
	echo 'make wheel   build a wheel with compiled kernels in dist/ (ARGS="hanging_slab": one scene)'
	echo 'make clean   remove .venv and everything built; recorded runs stay'

run:
	.ci/environment run
	$(MAKE) --no-print-directory .venv/.warm
	.venv/bin/python examples/first_light.py $(ARGS)

# Kernels of the scene that `make run` shows. Without them the node compiles by itself.
.venv/.warm: $(shell find icofabric_sim/kernels icofabric_sim/geometry -name '*.py')
	echo 'Compiling kernels ahead; this takes 20 s to a minute, or two on a slow or busy machine, once.'
	! .venv/bin/python -m icofabric_sim.commands.main warm hanging_slab || touch $@

lint:
	.ci/environment test
	$(call stage,lint (ruff),.venv/bin/ruff check .)
	$(call stage,types (mypy),.venv/bin/mypy)

language:
	.ci/environment test
	.venv/bin/python docs/language.py $(ARGS)

ifneq ($(ARGS),)
test: lint
	$(call stage,tests (pytest),.venv/bin/python -m pytest $(ARGS))
else
test:
	.ci/environment test
	.venv/bin/python test/browser.py
	$(call stage,lint (ruff),.venv/bin/ruff check .)
	$(call stage,tests side by side: physics 1 (pytest)$(comma) types (mypy),$(call types_beside,$(call workers,auto,test/physics/test_[a-m]*.py)))
	$(call side_by_side,physics 2,auto,test/physics/test_[n-z]*.py test/terms)
	$(call side_by_side,all else and nodes,$(twice),test validation/test --ignore test/physics --ignore test/terms)
endif

# Rules of the house, descriptions, messages, and the physics of bare fabrics: few kernels.
check: lint
	$(call stage,a selection of tests (pytest),.venv/bin/python -m pytest -m 'not graph and not long' -n auto \
	test/test_*.py validation/test/test_validation_package.py validation/test/repository test/geometry test/parameters/test_validation.py test/parameters/test_parameter_file.py test/messages \
	test/scene/test_initial.py test/physics/test_closed_forms.py test/physics/test_conservation.py test/simulation/reports/test_status.py)

test-long:
	.ci/environment test
	$(call stage,long tests (pytest),.venv/bin/python -m pytest -m long $(ARGS))
	$(call stage,what pages say,.venv/bin/python -m icofabric_validation.repository.claims)
	$(call stage,$(EXAMPLES) times the random examples (pytest),ICOFABRIC_EXAMPLES=$(EXAMPLES) .venv/bin/python -m pytest -m examples $(ARGS))

# On a quiet machine; ARGS="--cases S1 --no-baseline" takes less time.
bench: REF ?= HEAD~1
bench:
	.ci/environment test
	$(call stage,speed (icofabric_validation.benchmarks.regression),.venv/bin/python -m icofabric_validation.benchmarks.regression $(REF) $(ARGS))

docs:
	.ci/environment docs
	$(call stage,documentation (sphinx),.venv/bin/python -m sphinx -q -W --keep-going -b html docs build/site)
	echo 'The site begins at build/site/index.html'

films:
	.ci/environment test
	$(call stage,films (icofabric film),.venv/bin/python docs/draw_gallery.py $(ARGS))

# Compiles each scene for two levels: about a minute for two scenes and one level.
wheel:
	.ci/environment run
	$(call stage,wheel with compiled kernels (.ci/wheel.py),.venv/bin/python .ci/wheel.py $(ARGS))

clean:
	rm -rf .venv build install log dist {.,validation}/*.egg-info validation/build .pytest_cache .mypy_cache .ruff_cache .hypothesis .coverage
	find . -name .git -prune -o -type d -name __pycache__ -print0 | xargs -0 rm -rf
