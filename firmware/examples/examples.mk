# The examples are compiled by `make firmware`; `make budget` shows what each way to use the core takes of the flash.

EXAMPLE_CPU := -mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16
EXAMPLE_FLAGS := $(EXAMPLE_CPU) $(FIRMWARE_CFLAGS) -ffreestanding -Os -flto -ffunction-sections -fdata-sections
BUDGET_COMPENSATE_BYTES := 4608
EXAMPLES := $(BUILD)/firmware/examples/compensate.elf $(BUILD)/firmware/examples/calibrate.elf $(BUILD)/firmware/examples/imucal_mpu6050.o

$(BUILD)/obj/examples/%.o: %.c
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CC   $< (example)")
	$(Q)$(CCACHE) $(CROSS)gcc $(EXAMPLE_FLAGS) -MMD -MP $(FIRMWARE_CPPFLAGS) -c $< -o $@

# No start-up code: the loop of each example is the entry, what it calls of the application is left open.
$(BUILD)/firmware/examples/%.elf: $(BUILD)/obj/examples/firmware/examples/%.o $(CORE_SOURCES:%.c=$(BUILD)/obj/examples/%.o)
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CROSS)gcc $(EXAMPLE_FLAGS) -nostartfiles --specs=nano.specs -Wl,--gc-sections,-e,imu_loop,--unresolved-symbols=ignore-all $^ -o $@

# The sketch against the few declarations of the Arduino API that it uses (tests/emu/arduino).
$(BUILD)/firmware/examples/imucal_mpu6050.o: firmware/examples/imucal_mpu6050/imucal_mpu6050.ino
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CXX  $<")
	$(Q)$(CROSS)g++ $(EXAMPLE_CPU) -x c++ -std=gnu++17 -Os -fno-exceptions -fno-rtti -Wall -Wextra -Werror -MMD -MP -Itests/emu/arduino $(FIRMWARE_CPPFLAGS) -include Arduino.h -c $< -o $@

.SECONDARY: $(CORE_SOURCES:%.c=$(BUILD)/obj/examples/%.o) $(BUILD)/obj/examples/firmware/examples/compensate.o $(BUILD)/obj/examples/firmware/examples/calibrate.o
firmware: $(EXAMPLES)

budget: $(EXAMPLES) $(BUILD)/firmware/stm32f405/imucal.elf  ## flash of the core where it only compensates, where it learns too, and of the whole device
	@python3 firmware/examples/budget.py $(BUDGET_COMPENSATE_BYTES) $(CROSS)nm $(filter %.elf,$^)
.PHONY: budget
-include $(shell find $(BUILD)/obj/examples $(BUILD)/firmware/examples -name '*.d' 2>/dev/null)
