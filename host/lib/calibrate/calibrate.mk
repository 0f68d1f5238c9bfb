# `calibrate`: the device client and its tests' helpers.
LIBS_test_transport := -lserialport

$(BUILD)/tests/tty_shim.so: tests/emu/tty_shim.c
	@mkdir -p $(@D)
	$(Q)$(CC) -shared -fPIC -O1 $(WARNINGS) $< -o $@
