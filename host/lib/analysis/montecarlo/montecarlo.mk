# Monte Carlo validation of the C core: tables for the README, throughput, long campaigns.

# The generators round and take roots by the hundred million: as instructions, not as calls that set errno.
$(BUILD)/obj/host/host/lib/physics/sim/%.o $(BUILD)/obj/host/host/lib/base/%.o: CXXFLAGS += -O3 -fno-math-errno

# One second of the core's filter: its own text, with a vector of eight floats in place of each float (lanes.h).
# Its functions become part of those that call them, so that no vector is passed in a register that a processor may lack (psabi).
KF_OF_8 := $(BUILD)/gen/kf_of_8.h
$(KF_OF_8): common/kf.h common/kf.c host/lib/analysis/montecarlo/montecarlo.mk
	@mkdir -p $(@D)
	@{ echo '// Made of common/kf.h and common/kf.c by montecarlo.mk.'; \
	  sed -n '/^\/\* What the host decides/,/^} imucal_kf_t;/p' common/kf.h; \
	  sed -n '/^\/\* ---- one second/,/^\/\* ---- what callers/{/^\/\* ---- what callers/!p}' common/kf.c; } \
	  | sed 's/\bfloat\b/Lanes8f/g; s/static inline/static IMUCAL_WIDE_PART/' > $@.new && mv $@.new $@
$(BUILD)/obj/host/host/lib/analysis/montecarlo/room.o $(BUILD)/obj/host/host/lib/analysis/montecarlo/lanes.o: $(KF_OF_8)
$(BUILD)/obj/host/host/lib/analysis/montecarlo/%.o: private HOST_CPPFLAGS += -I$(BUILD)/gen
$(BUILD)/obj/host/host/lib/analysis/montecarlo/%.o: private HOST_CXXFLAGS += -fno-math-errno -Wno-psabi

# Raise or lower the number of simulated tests: make validation RUNS=400
RUNS ?= 4000
VALIDATION_SEED ?= 1

validation: $(BUILD)/bin/montecarlo  ## campaign: how well does it calibrate? the tables of the README (RUNS=4000; SAVE=1: as tests hold the README to them)
	$(Q)$(PYTHON) host/scripts/validation.py $(BUILD)/bin/montecarlo --runs $(RUNS) --seed $(VALIDATION_SEED) --out $(BUILD)/validation $(if $(SAVE),--save tests/saved/validation.md)
	$(if $(SAVE),$(Q)$(PYTHON) host/scripts/validation.py $(BUILD)/bin/montecarlo --short --out $(BUILD)/validation_short --save tests/saved/validation_short.md >$(BUILD)/validation_short.txt)

bench:: $(BUILD)/bin/montecarlo
	$(Q)$(PYTHON) host/scripts/bench_montecarlo.py $(BUILD)/bin/montecarlo --json $(BUILD)/bench_montecarlo.json

test-long:: $(BUILD)/bin/montecarlo
	$(Q)$(PYTHON) host/scripts/validation.py $(BUILD)/bin/montecarlo --runs $(RUNS) --seed $(VALIDATION_SEED) --out $(BUILD)/validation --check

.PHONY: validation
