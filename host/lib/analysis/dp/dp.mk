# `dp` and `errormodel`: benchmark, long studies, figures.

DP_STUDY := $(BUILD)/studies

$(BUILD)/tests/bench_dp $(BUILD)/tests/bench_log: $(BUILD)/tests/bench_%: $(BUILD)/obj/host/tests/bench/bench_%.o \
                                              $(patsubst %,$(BUILD)/lib/%.a,$(ROOMS_dp) common)
	@mkdir -p $(@D)
	$(Q)$(CXX) -pthread $^ $(LDFLAGS) $(HOST_LIBS) -o $@

campaign-programs: $(BUILD)/tests/bench_dp $(BUILD)/tests/bench_log

$(BUILD)/venv-bench/installed: host/scripts/requirements-bench.txt
	$(Q)/usr/bin/python3 -m venv $(BUILD)/venv-bench
	$(Q)$(BUILD)/venv-bench/bin/pip install --quiet --disable-pip-version-check -r $<
	$(Q)touch $@

bench-kernel: python-core $(BUILD)/venv-bench/installed  ## figure: the Allan deviation alone against allantools, array to array in one process
	$(Q)IMUCAL_BIN=$(abspath $(BUILD))/bin $(BUILD)/venv-bench/bin/python host/scripts/bench_kernel.py

bench:: host $(BUILD)/tests/bench_dp $(BUILD)/venv-bench/installed  ## figure: speed of the programs, against other programs too (allantools, avar from PyPI)
	$(Q)$(BUILD)/venv-bench/bin/python host/scripts/bench_dp.py --build $(BUILD) --seed $(SEED)

bench-whole: $(BUILD)/bin/dp $(BUILD)/bin/errormodel $(BUILD)/tests/bench_log $(BUILD)/venv-bench/installed  ## figure: whole commands beside numpy and allantools; ONLY=reading, dp, scaling or errormodel
	$(Q)$(BUILD)/venv-bench/bin/python host/scripts/bench_whole.py --build $(BUILD) $(if $(ONLY),--only $(ONLY))

bench-scaling:  ## figure: growth exponents of dp with length, taus, axes, logs and threads
	@$(MAKE) --no-print-directory bench-whole ONLY=scaling

# Of 200 draws: how often the 95 % interval of a maximum-likelihood fit holds the truth.
coverage-errormodel: $(BUILD)/bin/errormodel  ## campaign: coverage of the intervals of errormodel fit, 200 draws
	@mkdir -p $(DP_STUDY)
	$(Q)echo '{"imucal_model": 1, "arw_deg_rt_h": 0.6, "markov": [{"sigma_dph": 20, "tau_s": 100}]}' > $(DP_STUDY)/one_term.json
	$(Q)nice $(BUILD)/bin/errormodel validate --model $(DP_STUDY)/one_term.json --criterion ml --markov 1 --runs 200 --seed $(SEED)

# The same of the intervals by refits, on records long enough for the coarse expectation.
coverage-bootstrap: $(BUILD)/bin/errormodel  ## campaign: coverage of the intervals by refits on long records, 200 draws (DRAWS=200 CRITERION=ls or bound)
	$(Q)nice $(PYTHON) host/scripts/coverage_bootstrap.py $(BUILD)/bin/errormodel --draws $(or $(DRAWS),200) --seed $(SEED) --criterion $(or $(CRITERION),ls)

test-long:: host
	$(Q)$(PYTHON) host/scripts/study_errormodel.py --build $(BUILD) --seed $(SEED) --check

figures:: host  ## figure: draw the paper's figures and our own into build/figures
	$(Q)$(PYTHON) host/scripts/figures_dp.py --build $(BUILD) --seed $(SEED)

.PHONY: bench bench-kernel bench-scaling bench-whole coverage-bootstrap coverage-errormodel figures test-long
