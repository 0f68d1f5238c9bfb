# The list of effects, made from the files of this folder: one line IMUCAL_EFFECT(Type) at the end of a file enters it.
EFFECT_FOLDER := host/lib/physics/effects
EFFECT_LIST := $(BUILD)/gen/effect_list.inc

# Looked at in every build, so that a file that is added or taken away is seen; written only when it differs.
$(EFFECT_LIST): FORCE_EFFECT_LIST
	@mkdir -p $(@D)
	@$(EFFECT_FOLDER)/effect_list.sh $(EFFECT_FOLDER) > $@.new && { cmp -s $@.new $@ && rm -f $@.new || mv $@.new $@; }

EFFECT_USERS := $(BUILD)/obj/host/$(EFFECT_FOLDER)/library.o $(BUILD)/obj/host/$(EFFECT_FOLDER)/room.o
$(EFFECT_USERS): $(EFFECT_LIST)
$(EFFECT_USERS): private HOST_CPPFLAGS += -I$(BUILD)/gen

.PHONY: FORCE_EFFECT_LIST
