# Time and memory of diagnose, and how they grow with runs and seconds (calibration of the nulls apart); what each
# constant of the selector does.
BENCH_DIAGNOSE = $(PYTHON) host/scripts/bench_diagnose.py --bin $(BUILD)/bin
SELECTOR_TABLE := $(BUILD)/bench/selector_table
ORACLE := $(BUILD)/bench/oracle

bench:: $(BUILD)/bin/diagnose $(BUILD)/bin/gyrosim
	$(Q)$(BENCH_DIAGNOSE)

# CONSTANTS=name ...: only these
selector-table: $(SELECTOR_TABLE)  ## figure: what each constant of diagnose's selector does at half and at double (CONSTANTS=)
	$(Q)$(SELECTOR_TABLE) $(BUILD)/selector-cache $(CONSTANTS)

oracle: $(ORACLE)

$(SELECTOR_TABLE) $(ORACLE): $(BUILD)/bench/%: tests/bench/%.cpp $(BUILD)/flags/host_cxx \
                   $(patsubst %,$(BUILD)/lib/%.a,analysis/diagnose physics/sim physics/effects noise linear io base common)
	@mkdir -p $(@D)
	$(Q)$(CCACHE) $(CXX) $(HOST_CXXFLAGS) $(OPTIMISE) $(HOST_CPPFLAGS) $(CXXFLAGS) -c $< -o $@.o
	$(Q)$(CXX) -pthread $@.o $(filter %.a,$^) $(LDFLAGS) $(HOST_LIBS) -o $@

campaign-programs: $(SELECTOR_TABLE) $(ORACLE)

.PHONY: bench selector-table oracle
