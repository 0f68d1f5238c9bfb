# Speed that keeps itself: counts of instructions against the saved ones (tests/bench/kept.py).

KEPT = python3 tests/bench/kept.py
CHECK_IMAGES := $(FIRMWARE_PORTS:%=$(BUILD)/firmware/%/check.elf)

$(BUILD)/bench/kernels: tests/bench/kernels.cpp $(BUILD)/flags/host_cxx $(HOST_ARCHIVE)
	@mkdir -p $(@D)
	$(Q)$(CCACHE) $(CXX) $(HOST_CXXFLAGS) $(OPTIMISE) $(SANITIZE_FLAGS) $(HOST_CPPFLAGS) $(CXXFLAGS) -c $< -o $@.o
	$(Q)$(CXX) -pthread $(SANITIZE_FLAGS) $@.o $(HOST_ARCHIVE) $(LDFLAGS) $(HOST_LIBS) -o $@

unit-programs: $(BUILD)/bench/kernels

bench:: $(BUILD)/bench/kernels $(CHECK_IMAGES)
	$(Q)$(KEPT) measure --build $(BUILD)

bench-diff: $(BUILD)/bench/kernels $(CHECK_IMAGES)  ## figure: instructions of kernels and of the core against tests/bench/saved.json: status 1 at a loss of 20 %
	$(Q)$(KEPT) diff --build $(BUILD)

.PHONY: bench bench-diff
