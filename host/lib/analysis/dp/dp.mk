# `dp` and `errormodel`: benchmark, long studies, figures.

DP_STUDY := $(BUILD)/studies
DP_MODELS := tests/vectors/models

$(BUILD)/tests/bench_dp $(BUILD)/tests/bench_log: $(BUILD)/tests/bench_%: $(BUILD)/obj/host/tests/bench/bench_%.o \
                                              $(patsubst %,$(BUILD)/lib/%.a,$(ROOMS_dp) common)
	@mkdir -p $(@D)
	$(Q)$(CXX) -pthread $^ $(LDFLAGS) $(HOST_LIBS) -o $@

$(BUILD)/venv-bench/installed: host/scripts/requirements-bench.txt
	$(Q)/usr/bin/python3 -m venv $(BUILD)/venv-bench
	$(Q)$(BUILD)/venv-bench/bin/pip install --quiet --disable-pip-version-check -r $<
	$(Q)touch $@

bench:: host $(BUILD)/tests/bench_dp $(BUILD)/venv-bench/installed  ## times against other programs (allantools, avar from PyPI)
	$(Q)$(BUILD)/venv-bench/bin/python host/scripts/bench_dp.py --build $(BUILD) --seed $(SEED)

test-long:: host
	$(Q)$(PYTHON) host/scripts/study_errormodel.py --build $(BUILD) --seed $(SEED) --check

figures:: host  ## the paper's figures 1-6 and 13-21 from our own results, into build/figures
	$(Q)$(PYTHON) host/scripts/figures_dp.py --build $(BUILD) --seed $(SEED)

.PHONY: bench figures test-long
