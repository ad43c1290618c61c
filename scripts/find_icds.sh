#!/usr/bin/env bash
# Make OpenCL drivers that are here but not registered visible, without root: scripts/find_icds.sh FOLDER writes a file
# into FOLDER for each, which names the driver's library. harness/device/runtime.py shows FOLDER to the loader.
# A container with an NVIDIA GPU, for one, often has the driver's libnvidia-opencl.so.1 and no file that names it.
set -euo pipefail
folder=${1:?usage: find_icds.sh FOLDER}
registered=${OCL_ICD_VENDORS:-/etc/OpenCL/vendors}
DRIVERS="nvidia:libnvidia-opencl.so.1 amd:libamdocl64.so intel-gpu:libigdrcl.so pocl:libpocl.so.2"
PLACES="/usr/lib/x86_64-linux-gnu /usr/lib64 /usr/lib /usr/lib/aarch64-linux-gnu /usr/local/nvidia/lib64
    /usr/local/nvidia/lib /usr/local/cuda/compat /usr/lib/wsl/lib /opt/rocm/lib /usr/lib/x86_64-linux-gnu/intel-opencl"

# Print where library $1 lies: on the loader's path, in its cache, or in a usual place.
find_library() {
    local place
    local IFS=:
    for place in ${LD_LIBRARY_PATH:-}; do
        if [ -e "$place/$1" ]; then echo "$place/$1"; return; fi
    done
    IFS=$' \n'
    place=$({ ldconfig -p || /sbin/ldconfig -p; } 2>/dev/null | awk -v name="$1" '$1 == name { print $NF; exit }')
    if [ -n "$place" ]; then echo "$place"; return; fi
    for place in $PLACES; do
        if [ -e "$place/$1" ]; then echo "$place/$1"; return; fi
    done
    return 1
}

# Whether a registered file names library $1, in whatever folder or version.
is_registered() { grep -qs -F "${1%.so*}.so" "$registered"/*.icd; }

for driver in $DRIVERS; do
    name=${driver%%:*} library=${driver#*:}
    rm -f "$folder/found-$name.icd"
    if ! is_registered "$library" && path=$(find_library "$library"); then
        mkdir -p "$folder"
        echo "$path" >"$folder/found-$name.icd"
        echo "icds: $path was not registered; $folder/found-$name.icd names it now"
    fi
done
