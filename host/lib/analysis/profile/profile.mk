# Figures, tables and longer tests of the room `profile`.

PROFILE := $(BUILD)/bin/profile

figures:: $(PROFILE)
	$(Q)PROFILE=$(PROFILE) $(PYTHON) host/scripts/figures_profile.py $(BUILD)/figures

# 100, 140, 240, 480 min at 0.6 and 2 degC/min: bounds, best profile, efficiency, the paper's profile.
profile-table: $(PROFILE)  ## figure: bounds, best profiles and efficiencies for four durations and two rates
	$(Q)PROFILE=$(PROFILE) $(PYTHON) host/scripts/profile_table.py --seed $(SEED)

profile-oscillations: $(PROFILE)  ## figure: why the proven bound leaves 7 % open at 2 degC/min
	$(Q)PROFILE=$(PROFILE) $(PYTHON) host/scripts/profile_oscillations.py

bench:: $(BUILD)/bench/profile_speed
	$(Q)$(BUILD)/bench/profile_speed

test-long:: $(BUILD)/bench/profile_long
	$(Q)$(BUILD)/bench/profile_long $(SEED)

$(BUILD)/bench/profile_%: tests/bench/profile_%.cpp $(BUILD)/flags/host_cxx $(HOST_ARCHIVE)
	@mkdir -p $(@D)
	$(Q)$(CCACHE) $(CXX) $(HOST_CXXFLAGS) $(OPTIMISE) $(HOST_CPPFLAGS) $(CXXFLAGS) -c $< -o $@.o
	$(Q)$(CXX) -pthread $@.o $(HOST_ARCHIVE) $(LDFLAGS) $(HOST_LIBS) -o $@

campaign-programs: $(BUILD)/bench/profile_speed $(BUILD)/bench/profile_long

.PHONY: figures bench test-long profile-oscillations profile-table
