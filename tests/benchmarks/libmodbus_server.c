/* A server of libmodbus with all registers, the peer of the benchmark `serve`: its port, then at each line that it
   reads the processor time that it has used. */
#include <arpa/inet.h>
#include <modbus/modbus.h>
#include <stdio.h>
#include <sys/resource.h>
#include <sys/select.h>
#include <unistd.h>

int main(void) {
    modbus_t *bus = modbus_new_tcp("127.0.0.1", 0);
    modbus_mapping_t *registers = modbus_mapping_new(0, 0, 65536, 0);
    int listening = modbus_tcp_listen(bus, 32);
    struct sockaddr_in own;
    socklen_t size = sizeof own;
    getsockname(listening, (struct sockaddr *)&own, &size);
    printf("{\"port\": %d}\n", ntohs(own.sin_port));
    fflush(stdout);
    fd_set heard;
    FD_ZERO(&heard);
    FD_SET(0, &heard);
    FD_SET(listening, &heard);
    for (int most = listening;;) {
        fd_set ready = heard;
        select(most + 1, &ready, NULL, NULL, NULL);
        for (int fd = 0; fd <= most; fd++) {
            if (!FD_ISSET(fd, &ready)) continue;
            if (fd == 0) {
                char line[16];
                struct rusage used;
                if (read(fd, line, sizeof line) <= 0) return 0;
                getrusage(RUSAGE_SELF, &used);
                printf("{\"cpu\": %.6f}\n", used.ru_utime.tv_sec + used.ru_stime.tv_sec
                       + 1e-6 * (used.ru_utime.tv_usec + used.ru_stime.tv_usec));
                fflush(stdout);
            } else if (fd == listening) {
                int client = modbus_tcp_accept(bus, &listening);
                FD_SET(client, &heard);
                if (client > most) most = client;
            } else {
                uint8_t request[MODBUS_TCP_MAX_ADU_LENGTH];
                modbus_set_socket(bus, fd);
                int length = modbus_receive(bus, request);
                if (length > 0) modbus_reply(bus, request, length, registers);
                else if (length < 0) close(fd), FD_CLR(fd, &heard);
            }
        }
    }
}
