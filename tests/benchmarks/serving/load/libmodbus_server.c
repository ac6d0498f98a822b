/* libmodbus as a server of many connections: its own example's loop (select, receive, reply). Prints its port. */
#include <arpa/inet.h>
#include <modbus/modbus.h>
#include <netinet/tcp.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/select.h>
#include <unistd.h>

enum { REGISTERS = 400, QUEUE = 64 };

int main(void) {
    modbus_t *ctx = modbus_new_tcp("127.0.0.1", 0);
    modbus_mapping_t *map = modbus_mapping_new(0, 0, REGISTERS, REGISTERS);
    struct sockaddr_in here;
    socklen_t size = sizeof here;
    uint8_t query[MODBUS_TCP_MAX_ADU_LENGTH];
    fd_set all, ready;
    int one = 1, listener = modbus_tcp_listen(ctx, QUEUE);
    if (listener < 0 || !map || getsockname(listener, (void *)&here, &size)) return 1;
    for (int i = 0; i < REGISTERS; i++) map->tab_registers[i] = 7;
    printf("%d\n", ntohs(here.sin_port));
    fflush(stdout);
    FD_ZERO(&all);
    FD_SET(listener, &all);
    for (int last = listener;;) {
        ready = all;
        if (select(last + 1, &ready, NULL, NULL, NULL) < 0) return 1;
        for (int fd = 0; fd <= last; fd++) {
            if (!FD_ISSET(fd, &ready)) continue;
            if (fd == listener) {
                int link = accept(listener, NULL, NULL);
                setsockopt(link, IPPROTO_TCP, TCP_NODELAY, &one, sizeof one);
                FD_SET(link, &all);
                last = link > last ? link : last;
                continue;
            }
            modbus_set_socket(ctx, fd);
            int length = modbus_receive(ctx, query);
            if (length > 0) modbus_reply(ctx, query, length, map);
            else if (length < 0) { close(fd); FD_CLR(fd, &all); }
        }
    }
}
