# Monte Carlo validation of the C core: tables for the README, throughput, long campaigns.

# The generators round and take roots by the hundred million: as instructions, not as calls that set errno.
$(BUILD)/obj/host/host/lib/physics/sim/%.o $(BUILD)/obj/host/host/lib/base/%.o: CXXFLAGS += -O3 -fno-math-errno

# Raise or lower the number of simulated tests: make validation RUNS=400
RUNS ?= 4000
VALIDATION_SEED ?= 1

validation: $(BUILD)/bin/montecarlo  ## how well does it calibrate? the tables of the README (RUNS=4000; SAVE=1: as tests hold the README to them)
	$(Q)$(PYTHON) host/scripts/validation.py $(BUILD)/bin/montecarlo --runs $(RUNS) --seed $(VALIDATION_SEED) --out $(BUILD)/validation $(if $(SAVE),--save tests/saved/validation.md)
	$(if $(SAVE),$(Q)$(PYTHON) host/scripts/validation.py $(BUILD)/bin/montecarlo --short --out $(BUILD)/validation_short --save tests/saved/validation_short.md >$(BUILD)/validation_short.txt)

bench:: $(BUILD)/bin/montecarlo
	$(Q)$(PYTHON) host/scripts/bench_montecarlo.py $(BUILD)/bin/montecarlo --json $(BUILD)/bench_montecarlo.json

test-long:: $(BUILD)/bin/montecarlo
	$(Q)$(PYTHON) host/scripts/validation.py $(BUILD)/bin/montecarlo --runs $(RUNS) --seed $(VALIDATION_SEED) --out $(BUILD)/validation --check

.PHONY: validation
