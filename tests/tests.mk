# Tests.  tests/common/test_*.c and tests/host/test_*.cpp are CMocka programs, one per room;
# tests/system/test_*.py are pytest files that run the built programs and images from outside.

UNIT_TESTS := $(patsubst tests/%.c,$(BUILD)/tests/%,$(wildcard tests/common/test_*.c tests/firmware/test_*.c)) \
              $(patsubst tests/%.cpp,$(BUILD)/tests/%,$(wildcard tests/host/test_*.cpp))

# T="one two" runs the unit tests and pytest cases whose name contains one of the words.
SELECTED_UNIT_TESTS := $(call selected,$(UNIT_TESTS))
PYTEST_T := $(if $(T),-k '$(subst $(space), or ,$(strip $(T)))')

$(BUILD)/obj/host/tests/%.o: CFLAGS += -D_GNU_SOURCE
$(BUILD)/obj/host/tests/%.o: tests/%.c $(BUILD)/flags/host_c
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CC   $<")
	$(Q)$(CCACHE) $(CC) -std=c99 -ffp-contract=off $(WARNINGS) -Wno-conversion $(OPTIMISE) $(SANITIZE_FLAGS) -MMD -MP -Icommon -Ifirmware -Itests $(CFLAGS) -c $< -o $@
$(BUILD)/obj/host/tests/%.o: tests/%.cpp $(BUILD)/flags/host_cxx | $(NEEDS_PCH)
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CXX  $<")
	$(Q)$(CCACHE) $(COMPILE_CXX) $(USE_PCH) -Wno-conversion -MMD -MP -Itests -c $< -o $@

$(BUILD)/tests/%: $(BUILD)/obj/host/tests/%.o $(HOST_ARCHIVE)
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CXX) -pthread $(SANITIZE_FLAGS) $(filter %.o,$^) $(filter %.a,$^) $(LDFLAGS) $(HOST_LIBS) -lcmocka -lm -o $@

# Decompositions that tests of the host side compare with: Eigen takes seconds to compile them in every program.
$(filter $(BUILD)/tests/host/%,$(UNIT_TESTS)): $(BUILD)/obj/host/tests/host/dense.o

.SECONDARY: $(patsubst $(BUILD)/tests/%,$(BUILD)/obj/host/tests/%.o,$(UNIT_TESTS))

# `make test` on a bare machine installs first; the recursive call sees what was installed.
test:  ## test: install what is missing, build, and run all tests (T=<filter> for some)
	@$(MAKE) --no-print-directory deps
	@$(MAKE) --no-print-directory -j2 all unit-programs campaign-programs python-core
	@$(MAKE) --no-print-directory unit-test system-test

unit-programs: $(SELECTED_UNIT_TESTS)

# What no test runs is compiled all the same, so that it keeps up with the library.  Each *.mk names its own (test_campaigns.py).
campaign-programs:  ## test: build what only campaigns run (bench, blind-confusions, fuzz, soak, torn)

unit-test: unit-programs  ## test: run the CMocka tests of the core and the host library
	$(Q)BUILD=$(BUILD) tests/run_unit $(SELECTED_UNIT_TESTS)

# Three processes on two cores, since some tests wait for a device; each file in one of them: some files build or draw once for all
# of their tests.  What has a short form leaves its other draws (`long`) to test-long.
PYTEST = BUILD=$(BUILD) $(PYTHON) -m pytest -q -p no:cacheprovider --dist loadfile --no-loadscope-reorder $(PYTEST_T) tests/system tests/python
system-test:  ## test: run the pytest tests of the built programs
	$(Q)$(PYTEST) -n 3 -m 'not long'; code=$$?; [ $$code -eq 5 ] && [ -n "$(SELECTED_UNIT_TESTS)" ] || exit $$code # 5: T names unit tests alone

test-long:: host unit-programs  ## test: what `make test` leaves out: many more draws of tests that have a short form, tests of minutes
	$(Q)LONG=1 BUILD=$(BUILD) tests/run_unit $(filter %/test_diagnose_causes %/test_diagnose_noise %/test_diagnose_where %/test_fit,$(UNIT_TESTS))
	$(Q)$(PYTEST) -n 2 -m long

# The host side again under AddressSanitizer and UndefinedBehaviorSanitizer, in its own build folder.  An answer of diagnose
# takes ten times as long there: SHORT leaves the longest out, and says so.
sanitize: export SHORT ?= 1
sanitize sanitize-long:
	$(Q)$(MAKE) --no-print-directory BUILD=$(BUILD)/sanitize VENV=$(VENV) SANITIZE=1 -j2 host unit-programs
	$(Q)$(MAKE) --no-print-directory BUILD=$(BUILD)/sanitize VENV=$(VENV) SANITIZE=1 unit-test
sanitize:  ## test: unit tests under ASan and UBSan, without the longest answers of diagnose
sanitize-long:  ## test: the same with all of them (an hour)

.PHONY: test unit-programs campaign-programs unit-test system-test test-long sanitize sanitize-long
