# No input within its stated range makes the core overflow, leave an array or divide by zero (Frama-C Eva).
prove:  ## test: the core under Frama-C Eva: no alarm, or each argued in tests/prove/argued.txt
	$(Q)python3 tests/prove/prove.py --build $(BUILD)

.PHONY: prove

# clang-tidy on the core, the firmware's app and the external flash; cppcheck on these, on all other firmware and on the host's C++:
# no finding.  ctuuninitvar in kf.c: imucal_kf_get_state writes the struct that it is said to read.  What is said of the host and is
# not so stands in cppcheck_host.txt with its reason.
CPPCHECK := cppcheck -q --error-exitcode=1 --suppress=missingIncludeSystem --inline-suppr
NEEDS_CPPCHECK = @command -v cppcheck >/dev/null || { echo "needs cppcheck; install it with: apt-get install cppcheck" >&2; exit 3; }
NEEDS_TIDY = @command -v clang-tidy >/dev/null || { echo "needs clang-tidy; install it with: apt-get install clang-tidy" >&2; exit 3; }
PYFLAKES ?= pyflakes3
LINTED := common/*.c firmware/app/*.c firmware/flash/*.c
LINTED_FIRMWARE := firmware/sensors firmware/port/stm32f405 firmware/port/nrf51 firmware/port/riscv_virt firmware/port/arm firmware/port/posix firmware/port/sim
lint: lint-c lint-host lint-python  ## test: clang-tidy (.clang-tidy) on core and app, and all that lint-c, lint-host and lint-python see: no finding
	$(NEEDS_TIDY)
	$(Q)clang-tidy --quiet $(LINTED) -- -std=c99 -ffp-contract=off -Icommon -Ifirmware 2>/dev/null

lint-c:  ## test: cppcheck on core and firmware (seconds)
	$(NEEDS_CPPCHECK)
	$(Q)$(CPPCHECK) --std=c99 --enable=warning,style,performance,portability --suppress=ctuuninitvar:common/kf.c \
	  -Icommon -Ifirmware $(LINTED)
	$(Q)$(CPPCHECK) --std=c99 --enable=warning,performance,portability -Icommon -Ifirmware $(LINTED_FIRMWARE)

lint-python:  ## test: pyflakes on every Python file (seconds)
	@command -v $(PYFLAKES) >/dev/null || { echo "needs pyflakes; install it with: apt-get install pyflakes3" >&2; exit 3; }
	$(Q)git ls-files '*.py' | xargs $(PYFLAKES)

lint-host:  ## test: cppcheck on the host's C++ (half a minute)
	$(NEEDS_CPPCHECK)
	$(Q)$(CPPCHECK) --std=c++17 --enable=warning,performance,portability --suppressions-list=tests/prove/cppcheck_host.txt \
	  -Icommon -Ihost/lib -Ihost/tools host/lib host/tools host/python/native

# A room in one piece, as it is compiled: Eigen and JSON are read once for it.  ROOM=host/lib/io for one.
ROOM ?=
TIDY_PIECES := $(HOST_ROOMS:%=host/lib/%/room) $(foreach t,$(TOOLS),host/tools/$t/$(if $(wildcard host/tools/$t/main.cpp),program,room))
TIDY_PIECES := $(patsubst %,$(BUILD)/gen/%.cpp,$(if $(ROOM),$(filter $(ROOM)/%,$(TIDY_PIECES)),$(TIDY_PIECES)))
lint-tidy-host: $(TIDY_PIECES)  ## test: clang-tidy (host/.clang-tidy) on the host's C++: no finding (ROOM=host/lib/io for one; ten minutes for all)
	$(NEEDS_TIDY)
	$(Q)printf '%s\n' $^ | xargs -P 2 -I{} sh -c 'clang-tidy --quiet --config-file=host/.clang-tidy {} -- -std=c++17 -iquote . \
	  $(filter-out -DIMUCAL_VERSION%,$(HOST_CPPFLAGS)) "-DIMUCAL_VERSION=\"$(VERSION)\"" -I$(BUILD)/gen 2>/dev/null || { echo "lint-tidy-host: {}" >&2; exit 1; }'

misra:  ## test: MISRA C:2012 rules that the core deviates from, with their counts (common/README.md says why)
	$(NEEDS_CPPCHECK)
	$(Q)cd common && cppcheck --std=c99 -q --addon=misra -I. *.c 2>&1 | grep -oE 'misra-c2012-[0-9.]+' | sort | uniq -c | sort -rn

.PHONY: lint lint-c lint-python lint-host lint-tidy-host misra
