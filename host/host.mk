# Host side.  The tiers of host/lib (host/README.md) go into one archive with common/*.c; host/tools/NAME/main.cpp is a
# program, what stands beside it is its text and JSON.

# A program that needs more than the archive names it here: LIBS_<program>.
HOST_LIBS ?= -lnlopt -lClp
LIBS_calibrate := -lserialport

HOST_CPPFLAGS := -Icommon -Ihost/lib -Ihost/tools -isystem /usr/include/eigen3 -DIMUCAL_VERSION='"$(VERSION)"' -DEIGEN_MPL2_ONLY
HOST_CXXFLAGS := -std=c++17 -pedantic -ffp-contract=off -pthread $(WARNINGS)
comma := ,
SANITIZE_FLAGS := $(if $(SANITIZE),-fsanitize=address$(comma)undefined -fno-sanitize-recover=all -fno-omit-frame-pointer)

CORE_SOURCES := $(wildcard common/*.c)
HOST_MAINS := $(wildcard host/tools/*/main.cpp)
HOST_SOURCES := $(filter-out $(HOST_MAINS),$(wildcard host/lib/*/*.cpp host/lib/*/*/*.cpp host/tools/*/*.cpp))
HOST_PROGRAMS := $(HOST_MAINS:host/tools/%/main.cpp=$(BUILD)/bin/%)
HOST_ARCHIVE := $(BUILD)/lib/libimucal.a
HOST_OBJECTS := $(CORE_SOURCES:%.c=$(BUILD)/obj/host/%.o) $(HOST_SOURCES:%.cpp=$(BUILD)/obj/host/%.o)

host: $(HOST_PROGRAMS)  ## build the host programs into build/bin

$(BUILD)/obj/host/%.o: %.c
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CC   $<")
	$(Q)$(CCACHE) $(CC) $(CORE_CFLAGS) $(OPTIMISE) $(SANITIZE_FLAGS) -MMD -MP -Icommon $(CFLAGS) -c $< -o $@

$(BUILD)/obj/host/%.o: %.cpp
	@mkdir -p $(@D)
	$(if $(V),,@echo "  CXX  $<")
	$(Q)$(CCACHE) $(CXX) $(HOST_CXXFLAGS) $(OPTIMISE) $(SANITIZE_FLAGS) -MMD -MP $(HOST_CPPFLAGS) $(CXXFLAGS) -c $< -o $@

$(HOST_ARCHIVE): $(HOST_OBJECTS)
	@mkdir -p $(@D)
	$(Q)rm -f $@ && $(AR) rcs $@ $^

$(BUILD)/bin/%: $(BUILD)/obj/host/host/tools/%/main.o $(HOST_ARCHIVE)
	@mkdir -p $(@D)
	$(if $(V),,@echo "  LINK $@")
	$(Q)$(CXX) -pthread $(SANITIZE_FLAGS) $< $(HOST_ARCHIVE) $(LDFLAGS) $(LIBS_$*) $(HOST_LIBS) -o $@

.SECONDARY: $(HOST_MAINS:%.cpp=$(BUILD)/obj/host/%.o)

-include $(shell find $(BUILD)/obj/host -name '*.d' 2>/dev/null)
