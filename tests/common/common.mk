# Figures of the core on this machine: the filter against long double (more models, to 10 days), comp's worst error.
core-figures: $(BUILD)/tests/common/test_kf $(BUILD)/tests/common/test_comp  ## figure: print float32 against long double, and comp's worst error
	$(Q)IMUCAL_PRINT=1 SLOW=1 $(BUILD)/tests/common/test_kf 2>/dev/null | grep '^order'
	$(Q)IMUCAL_PRINT=1 $(BUILD)/tests/common/test_comp 2>/dev/null | grep '^comp:'

test-long:: $(BUILD)/tests/common/test_kf
	$(Q)SLOW=1 $(BUILD)/tests/common/test_kf >/dev/null

.PHONY: core-figures
