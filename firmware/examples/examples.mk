# The examples are compiled by `make firmware`; `make budget` shows what each way to use the core takes of the flash.

EXAMPLE_CPU := -mcpu=cortex-m4 -mthumb -mfloat-abi=hard -mfpu=fpv4-sp-d16
EXAMPLE_PLAIN_FLAGS := $(EXAMPLE_CPU) $(FIRMWARE_CFLAGS) -ffreestanding -Os -ffunction-sections -fdata-sections
EXAMPLE_FLAGS := $(EXAMPLE_PLAIN_FLAGS) -flto
BUDGET_COMPENSATE_BYTES := 4608
EXAMPLES := $(BUILD)/firmware/examples/compensate.elf $(BUILD)/firmware/examples/calibrate.elf $(BUILD)/firmware/examples/imucal_mpu6050.o

FLAGS_examples = $(CROSS)gcc $(EXAMPLE_FLAGS) $(FIRMWARE_CPPFLAGS)
$(BUILD)/obj/examples/%.o: %.c $(BUILD)/flags/examples
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CC   $< (example)")
	$(Q)$(CCACHE) $(CROSS)gcc $(EXAMPLE_FLAGS) -MMD -MP $(FIRMWARE_CPPFLAGS) -c $< -o $@

# No start-up code: the loop of each example is the entry, what it calls of the application is left open.
$(BUILD)/firmware/examples/%.elf: $(BUILD)/obj/examples/firmware/examples/%.o $(CORE_SOURCES:%.c=$(BUILD)/obj/examples/%.o)
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CROSS)gcc $(EXAMPLE_FLAGS) -nostartfiles --specs=nano.specs -Wl,--gc-sections,-e,imu_loop,--unresolved-symbols=ignore-all $^ -o $@

# The same without link-time optimisation, for who cannot use it.
$(BUILD)/obj/examples_plain/%.o: %.c $(BUILD)/flags/examples
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CC   $< (example, no -flto)")
	$(Q)$(CCACHE) $(CROSS)gcc $(EXAMPLE_PLAIN_FLAGS) -MMD -MP $(FIRMWARE_CPPFLAGS) -c $< -o $@
$(BUILD)/firmware/examples/compensate_plain.elf: $(BUILD)/obj/examples_plain/firmware/examples/compensate.o $(CORE_SOURCES:%.c=$(BUILD)/obj/examples_plain/%.o)
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CROSS)gcc $(EXAMPLE_PLAIN_FLAGS) -nostartfiles --specs=nano.specs -Wl,--gc-sections,-e,imu_loop,--unresolved-symbols=ignore-all $^ -o $@
EXAMPLES += $(BUILD)/firmware/examples/compensate_plain.elf

# The sketch against the few declarations of the Arduino API that it uses (tests/emu/arduino).
$(BUILD)/firmware/examples/imucal_mpu6050.o: firmware/examples/imucal_mpu6050/imucal_mpu6050.ino $(BUILD)/flags/examples
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CXX  $<")
	$(Q)$(CROSS)g++ $(EXAMPLE_CPU) -x c++ -std=gnu++17 -Os -fno-exceptions -fno-rtti -Wall -Wextra -Werror -MMD -MP -Itests/emu/arduino $(FIRMWARE_CPPFLAGS) -include Arduino.h -c $< -o $@

# The same sketch as a process: Serial a pseudo-terminal, Wire a modelled MPU-6050 (tests/emu/arduino/native.cpp).
SKETCH_C := $(BUILD)/obj/host/tests/emu/arduino/wire_model.o
SKETCH_FLAGS := -std=gnu++17 -O1 -Wall -Wextra -Werror -MMD -MP -Itests -Itests/emu/arduino $(FIRMWARE_CPPFLAGS) $(SANITIZE_FLAGS)
FLAGS_sketch = $(CXX) $(SKETCH_FLAGS) $(LDFLAGS)
$(BUILD)/obj/host/sketch/%.o: tests/emu/arduino/%.cpp $(BUILD)/flags/sketch
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CXX  $<")
	$(Q)$(CCACHE) $(CXX) $(SKETCH_FLAGS) -c $< -o $@
$(BUILD)/obj/host/sketch/imucal_mpu6050.o: firmware/examples/imucal_mpu6050/imucal_mpu6050.ino $(BUILD)/flags/sketch
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CXX  $<")
	$(Q)$(CXX) $(SKETCH_FLAGS) -x c++ -include Arduino.h -c $< -o $@
$(BUILD)/tests/emu/sketch: $(BUILD)/obj/host/sketch/native.o $(BUILD)/obj/host/sketch/imucal_mpu6050.o $(SKETCH_C) $(FIRMWARE_APP_HOST) \
  $(patsubst %.c,$(BUILD)/obj/host/%.o,firmware/sensors/sensor.c firmware/sensors/source.c firmware/sensors/mpu6050.c) $(FIRMWARE_CORE_HOST)
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CXX) $(SANITIZE_FLAGS) $^ $(LDFLAGS) -lm -o $@
EXAMPLES += $(BUILD)/tests/emu/sketch

.SECONDARY: $(CORE_SOURCES:%.c=$(BUILD)/obj/examples/%.o) $(BUILD)/obj/examples/firmware/examples/compensate.o $(BUILD)/obj/examples/firmware/examples/calibrate.o
firmware: $(EXAMPLES)

BUDGET_IMAGES := $(addprefix $(BUILD)/firmware/,examples/compensate.elf examples/compensate_plain.elf examples/calibrate.elf stm32f405/imucal.elf stm32f405_w25q/imucal.elf)
budget: $(BUDGET_IMAGES)  ## figure: flash of the core where it only compensates, where it learns too, and of the whole device
	@python3 firmware/examples/budget.py $(BUDGET_COMPENSATE_BYTES) $(CROSS)nm $(filter %.elf,$^)
.PHONY: budget
-include $(shell find $(BUILD)/obj/examples $(BUILD)/obj/host/sketch $(BUILD)/firmware/examples -name '*.d' 2>/dev/null)
