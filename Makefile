# imucal: static thermal calibration of inertial sensors.   `make help` lists the targets.
# Knobs: CC CXX CROSS BUILD SEED T=<parts of test names> V=1 DEBUG=1 CFLAGS CXXFLAGS LDFLAGS (yours win).
# Rules live with what they build: host/host.mk, firmware/firmware.mk, tests/tests.mk and */*/*.mk.

BUILD ?= build
CROSS ?= arm-none-eabi-
CCACHE ?= $(shell command -v ccache)
# A build in a folder of its own (sanitize, portable) takes the venv that is there.
VENV ?= $(BUILD)/venv
PYTHON ?= $(VENV)/bin/python
SEED ?= 1
T ?=

# The one home of the version is common/version.h.
VERSION := $(shell sed -n 's,^#define IMUCAL_VERSION "\(.*\)",\1,p' common/version.h)
WARNINGS := -Wall -Wextra -Wconversion -Wshadow -Wundef -Werror
OPTIMISE := $(if $(DEBUG),-Og -g3,-O2)
# The core's arithmetic is the same on every machine: no contraction into fused operations.
CORE_CFLAGS := -std=c99 -pedantic -ffreestanding -ffp-contract=off -fno-common $(WARNINGS) -Wstrict-prototypes -Wdouble-promotion
Q := $(if $(V),,@)
comma := ,
space := $(subst ,, )
# T means the same everywhere: the tests of whose names one of its words is a part.  $1: names of tests, or their programs.
is_selected = $(strip $(foreach word,$(T),$(findstring $(word),$(1:$(BUILD)/tests/%=%))))
selected = $(if $(T),$(strip $(foreach t,$1,$(if $(call is_selected,$t),$t))),$1)
# Where a target would go on with no test at all: a T that is mistyped must not look like a pass.
some_selected = $(or $(call selected,$1),$(error T=$(T) is part of no name of these tests: $(notdir $1)))

all: host firmware  ## build: build the host programs and the firmware images (default)
.DEFAULT_GOAL := all

include host/host.mk
include firmware/firmware.mk
include tests/tests.mk
include $(wildcard host/*/*.mk host/lib/*/*.mk host/lib/*/*/*.mk host/tools/*/*.mk tests/*/*.mk)

# ---- flags ----
# An object is compiled again when its flags change (DEBUG=1, CFLAGS, CC, HSE_HZ): it needs $(BUILD)/flags/NAME, which holds the
# text of FLAGS_NAME and is written when that text is another one.  No path of BUILD in it: the same folder has more names.
# Written by a recipe, so that `make -n` and `make help` change nothing; read without a process (make 4.3 may leave the end of the
# line).
# $1 name
define flag_stamp
FLAGS_$1 := $$(strip $$(FLAGS_$1))
$(BUILD)/flags/$1: $$(if $$(call is_same,$$(FLAGS_$1),$$(strip $$(file <$(BUILD)/flags/$1))),,OTHER_FLAGS)
	@mkdir -p $$(@D)
	@printf '%s\n' '$$(subst ','\'',$$(FLAGS_$1))' >$$@
endef
is_same = $(and $(findstring $1,$2),$(findstring $2,$1))
OTHER_FLAGS:
.PHONY: OTHER_FLAGS
$(foreach name,$(patsubst FLAGS_%,%,$(filter FLAGS_%,$(.VARIABLES))),$(eval $(call flag_stamp,$(name))))

deps:  ## build: install Debian and Python packages that are missing
	@.ci/bootstrap $(VENV)

clean:  ## build: remove what was built, keep the Python venv
	$(Q)find $(BUILD) -mindepth 1 -maxdepth 1 ! -name venv -exec rm -rf {} +

distclean:  ## build: remove everything that was built or installed under build/
	$(Q)rm -rf $(BUILD)

format:  ## build: rewrite the sources in the project's style
	$(Q)git ls-files '*.c' '*.h' '*.cpp' | xargs clang-format -i

format-check:  ## build: fail where a source is not in the project's style
	$(Q)git ls-files '*.c' '*.h' '*.cpp' | xargs clang-format --dry-run -Werror

# `target: ...  ## group: what it does` is a line of the list.
HELP_GROUPS := build test campaign figure package
help:  ## build: this list
	@for group in $(HELP_GROUPS); do echo "$$group"; \
	  sed -nE "s/^([a-z0-9-]+)::?( .*)?## $$group: (.*)/\1\t\3/p" $(MAKEFILE_LIST) | sort | \
	  awk -F '\t' '{printf "  make %-20s %s\n", $$1, $$2}'; done

.PHONY: all deps clean distclean format format-check help host firmware
