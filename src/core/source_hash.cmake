# Write the hash of all sources of the core to a header: cmake -DSOURCES=... -DFOLDER=... -DOUTPUT=... -P source_hash.cmake
# Campaigns store it with their rows, so that rows of another version of the core are judged again.
list(SORT SOURCES)
set(hashes "")
foreach(source IN LISTS SOURCES)
    file(SHA256 "${source}" hash)
    file(RELATIVE_PATH name "${FOLDER}" "${source}")
    string(APPEND hashes "${name} ${hash}\n")
endforeach()
string(SHA256 all "${hashes}")
file(CONFIGURE OUTPUT "${OUTPUT}" CONTENT "#define PINPROOF_SOURCE_HASH \"${all}\"\n")
